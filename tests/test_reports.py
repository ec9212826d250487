import json
import math
import re
import sys
import xml.etree.ElementTree as ET
from types import SimpleNamespace

import matplotlib as mpl
import pytest

from archerfish.reports.progress import bar
from archerfish.reports.report import PageLink, Report, Reported, Result, badge
from archerfish.reports.style import look, new_figure, plot_style, svg_text
from archerfish.reports.table import Estimate, Table, entry_texts, tables_text
from archerfish.robot import Robot

ESTIMATES = [
    (Estimate(98.765, 97.0, 100.0, "%"), ("98.8", "97.0–100")),
    (Estimate(-1.23, -2.0, -0.04, "points"), ("−1.2", "−2.0…+0.0")),
    (Estimate(9.8123, 9.62, 9.98, "Hz"), ("9.81 Hz", "9.62 to 9.98")),
    (Estimate(1234.5, 1100.0, 1400.0), ("1234", "1100 to 1400")),
    (Estimate(5.0, math.nan, math.nan, "s"), ("5.000 s", "")),
    (Estimate(math.nan, 0.0, 1.0), ("–", "")),
    ("two\nlines \x1b[31m", ("two lines \\x1b[31m", "")),
]


def figure():
    with plot_style():
        found, axes = new_figure(1, 2)
        axes[0, 0].plot([0, 1], [1, 3], label="line", **look(8))
        axes[0, 0].legend()
    return found


ROWS = (("pitch", Estimate(1.031, 1.0193, 1.0427), 25000), ("<b>yaw", None, math.nan))
TABLE = Table('Gain & "delay"', ("axis", "gain", "count"), ROWS, note="a note")
FACTS = {"usable": False, "next_steps": ("record a step",), "provenance": {"seed": 3, "versions": {"numpy": "2"}}}
PARTS = {"tables": (TABLE,), "figures": (("first", figure), ("second", figure))}
REPORT = Report(title="<script>alert(1)</script>", headline="Not to be used.", **FACTS, **PARTS)


@pytest.mark.parametrize(("entry", "expected"), ESTIMATES)
def test_estimates_have_the_digits_that_their_intervals_give_reason_for(entry, expected):
    assert entry_texts(entry) == expected


def test_a_table_fits_its_width_with_intervals_beside_or_below():
    wide = Table("Wide", ("name", *"abcd"), (("row", *[Estimate(88.4, 87.1, 89.6, "%")] * 4),))
    beside, below = (tables_text([wide], width).split("\n")[2:] for width in (75, 60))
    assert beside == ["row " + 4 * " 88.4 (87.1–89.6)"]
    assert below == ["row " + 4 * "       88.4", "    " + 4 * "  87.1–89.6"]


def test_a_notebook_shows_reports_and_figures_and_text_holds_its_tables(monkeypatch):
    expected = str(REPORT)
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    assert str(REPORT) == expected
    reported = type("Found", (Reported,), {"report": REPORT})()
    assert "<h3>Gain &amp; &#34;delay&#34;</h3>" in reported._repr_html_() == REPORT._repr_html_()
    assert "<style>" not in REPORT._repr_html_()
    assert figure()._repr_png_().startswith(b"\x89PNG")


def test_a_report_prints_all_but_its_figures_and_is_plain_json():
    for said in ("Not to be used.", "What to do next", "record a step", "1.031 (1.019 to 1.043)", "a note"):
        assert said in str(REPORT)
    facts = json.loads(json.dumps(REPORT.to_dict(), allow_nan=False))
    assert (facts["tables"][0]["rows"][1], facts["figures"]) == (["<b>yaw", None, None], ["first", "second"])


def test_a_page_needs_nothing_but_itself_and_escapes_every_text(tmp_path, refused):
    REPORT.write_page(tmp_path / "new" / "page.html")
    page = (tmp_path / "new" / "page.html").read_text()
    assert re.findall(r"<(script|link|img|iframe|b)\b|(?:src|href)=\"(?!#)", page) == []
    assert all(said in page for said in ("&lt;script&gt;", "Not usable", "1.019 to 1.043", "numpy: 2"))
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert (len(set(ids)), page.count("<svg")) == (len(ids), 2)
    refused("can't be written", REPORT.write_page, tmp_path / "new" / "page.html" / "inside.html")


def test_a_page_links_to_pages_that_are_there_and_is_amber_where_a_usable_robot_has_assumed_parts(tmp_path):
    robot, page = tmp_path / "mine" / "robot.html", tmp_path / "mine" / "evaluation" / "report.html"
    assert REPORT.linked(page, [robot]).links == ()
    REPORT.write_page(robot)
    REPORT.linked(page, [robot]).write_page(page)
    assert '<a class="" href="../robot.html">mine</a>' in page.read_text()
    assert re.search(r"figure svg {[^}]*max-width: 100%; height: auto", page.read_text())
    parts = PageLink("pitch", "pitch.html", "usable"), PageLink("yaw", verdict="assumed")
    colors = [badge(usable, parts)[1] for usable in (True, False, None)]
    assert (badge(True, parts[:1])[1], colors) == ("good", ["fair", "bad", ""])


def test_a_result_is_saved_into_a_folder_or_to_the_path_of_its_record(tmp_path):
    record = Robot.paper().pitch
    result = type("Found", (Result,), {"record": record, "report": REPORT})()
    result.save(tmp_path / "new")
    result.save(tmp_path / "f1.json")
    for path in (tmp_path / "new" / "pitch.json", tmp_path / "f1.json"):
        assert repr(type(record).load(path)) == repr(record)
        assert path.with_suffix(".html").is_file()


@pytest.mark.parametrize("shown", ["lines", "notebook"])
def test_without_a_terminal_progress_is_a_line_a_minute_or_one_that_changes(shown, monkeypatch, capsys):
    clock, texts, said = [0.0], [], SimpleNamespace(update=lambda each, raw: texts.append(each["text/plain"]))
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    if shown == "notebook":
        display = SimpleNamespace(display=lambda *_, **__: said)
        shell = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel="a kernel"))
        for name, module in {"IPython": shell, "IPython.display": display}.items():
            monkeypatch.setitem(sys.modules, name, module)
    else:  # which says nothing of what runs this
        monkeypatch.setitem(sys.modules, "ipykernel", said)
    with bar("evaluating", 4000, "shots", "compiling") as advance:
        for clock[0] in range(0, 200, 10):
            advance(10 * clock[0], "oracle")
        advance(4000)
    found = texts if shown == "notebook" else capsys.readouterr().err.splitlines()
    assert len(found) == {"notebook": 21, "lines": 5}[shown]
    assert found[0] == "evaluating: 0 of 4,000 shots, 0.0 min; compiling"
    assert "evaluating: 1,200 of 4,000 shots, 2.0 min, about 4.7 min left; oracle" in found


def test_svg_is_the_same_every_time_no_two_curves_look_alike_and_the_global_settings_stay():
    before, label = dict(mpl.rcParams), 'pitch "true" & found'
    text, again = (svg_text(figure(), prefix="fig4", label=label) for _ in range(2))
    assert (text, dict(mpl.rcParams)) == (again, before)
    root = ET.fromstring(text)
    assert root.attrib["aria-label"] == label
    ids = {each.attrib["id"] for each in root.iter() if "id" in each.attrib}
    assert {f"fig4-{each}" for each in re.findall(r"url\(#fig4-([^)]+)\)", text)} <= ids
    assert len({(look(place)["color"], look(place)["marker"]) for place in range(56)}) == 56
