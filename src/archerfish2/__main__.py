"""`python -m archerfish2 COMMAND`."""

from archerfish2.cli.main import program

if __name__ == "__main__":
    program()
