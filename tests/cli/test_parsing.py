from dataclasses import dataclass

import pytest

from archerfish.cli.parsing import description, one_line, parse
from archerfish.records.errors import InputError


@dataclass(frozen=True)
class Options:
    """Do a thing.

    A paragraph that goes on for so long that it must be wrapped where the terminal ends, not in the middle of a word
    and not at the end of the line that it has in the source.

    Examples:
      program --count 1
    """

    count: int = 0
    """How many."""


def test_options_are_read():
    assert parse(Options, "program", ["--count", "3"]) == Options(3)


def test_a_fault_names_the_option_and_the_help():
    with pytest.raises(InputError, match=r"^--count: .* 'x'; see program --help$"):
        parse(Options, "program", ["--count", "x"])


def test_help_exits_with_status_0(capsys):
    with pytest.raises(SystemExit) as ended:
        parse(Options, "program", ["--help"])
    assert not ended.value.code
    assert "How many." in capsys.readouterr().out


def test_description_is_wrapped_and_keeps_examples(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    lines = description(Options).splitlines()
    assert lines[0] == "Do a thing."
    assert lines[1].startswith("  • A paragraph")
    assert lines[-3:] == ["", "Examples:", "  program --count 1"]
    assert max(map(len, lines)) <= 60


FRAMED = """\
╭─ Unrecognized options ───╮
│ \x1b[1mUnknown: --cuont,\x1b[0m │
│ 3                        │
│ ──────────────────────── │
│ Perhaps you meant:       │
│     --count INT          │
│         How many.        │
╰──────────────────────────╯
"""

PLAIN = """\
 Unrecognized options
 --------------------
  Unknown: --cuont, 3
  -------------------
  Perhaps you meant:
      --count INT

"""


@pytest.mark.parametrize("box", [FRAMED, PLAIN])
def test_box_is_condensed(box):
    assert one_line(box) == "Unknown: --cuont, 3; perhaps you meant --count"


def test_an_unknown_form_of_fault_is_told_as_it_is():
    assert one_line("error: no\n  box") == "error: no box"
