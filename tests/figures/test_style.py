import xml.etree.ElementTree as ET

import matplotlib as mpl
import pytest

from archerfish.figures.style import MARKERS, PALETTE, label_axes, new_figure, plot_style, save_figure, svg_text
from archerfish.records.errors import InputError


def figure():
    with plot_style():
        found, axes = new_figure(1, 2)
        axes[0, 0].plot([0, 1], [1, 3], label="line", marker=MARKERS[0])
        axes[0, 0].legend()
        label_axes(axes[0, 0], title="Title", x="Time [s]", y="Angle [°]")
    return found


def test_the_same_figure_gives_the_same_bytes():
    assert svg_text(figure()) == svg_text(figure())


def test_svg_is_an_element_for_a_page():
    text = svg_text(figure(), prefix="fig4", label='pitch "true" & found')
    root = ET.fromstring(text)
    assert root.tag.endswith("svg")
    assert root.attrib["aria-label"] == 'pitch "true" & found'
    assert "<?xml" not in text
    assert "http-equiv" not in text
    ids = {element.attrib["id"] for element in root.iter() if "id" in element.attrib}
    assert ids
    assert all(each.startswith("fig4-") for each in ids)
    for element in root.iter():
        for name, value in element.attrib.items():
            if name.endswith("href"):
                assert value.removeprefix("#") in ids
            if value.startswith("url(#"):
                assert value[5:-1] in ids


def test_the_style_leaves_the_global_settings_alone():
    before = dict(mpl.rcParams)
    figure()
    assert dict(mpl.rcParams) == before


@pytest.mark.parametrize(("name", "magic"), [("a.svg", b"<?xml"), ("a.png", b"\x89PNG"), ("a.pdf", b"%PDF")])
def test_figures_are_written_in_the_format_of_their_ending(tmp_path, name, magic):
    save_figure(tmp_path / "new" / name, figure())
    assert (tmp_path / "new" / name).read_bytes().startswith(magic)
    assert [path.name for path in (tmp_path / "new").iterdir()] == [name]


def test_another_ending_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"name it \.svg, \.png or \.pdf"):
        save_figure(tmp_path / "a.bmp", figure())


def test_every_colour_has_a_marker_of_its_own():
    assert len(set(PALETTE)) == len(set(MARKERS)) == len(PALETTE)
