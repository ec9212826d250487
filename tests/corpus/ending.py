"""How a command ended on a file of the corpus."""

import re

from archerfish.cli.main import main


def ended(*words):
    """Run a command in this process and return its exit status."""
    try:
        main([str(word) for word in words])
    except SystemExit as end:
        return end.code
    return 0


def assert_refused(status, printed, code, *nothing_at):
    """Check that a command ended in one line with the code, and left nothing behind."""
    assert status == 2
    assert re.fullmatch(rf"archerfish: error: [^\n]* \({code}\)\n", printed.err)
    assert not any(path.exists() for path in nothing_at)
