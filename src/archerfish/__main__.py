"""`python -m archerfish COMMAND`."""

from archerfish.cli.main import program

if __name__ == "__main__":
    program()
