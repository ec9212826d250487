import sys

import pytest

from archerfish2.progress import bar


def test_bars_are_shown_where_somebody_watches_and_nowhere_else(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for is_terminal in (False, True):
        monkeypatch.setattr(sys.stderr, "isatty", lambda is_terminal=is_terminal: is_terminal)
        monkeypatch.setenv("COLUMNS", "120")
        with bar("evaluate", 100, "shots") as advance:
            with bar("tune", 10, "settings") as inner:
                inner(5, note="kalman")
            advance(100, "gate")
        shown = capsys.readouterr()
        assert [text in shown.err for text in ("evaluate", "100/100", "shots/s", "gate")] == [is_terminal] * 4
        assert shown.out == ""
