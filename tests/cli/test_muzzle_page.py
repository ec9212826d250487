import re
from dataclasses import replace

import numpy as np
import pytest

from archerfish.cli.muzzle_page import muzzle_page
from archerfish.cli.muzzle_verdict import muzzle_verdict
from archerfish.identification.muzzle.likelihood import identify_muzzle
from archerfish.records.shots import Shots

DRAG, HEIGHT, LENGTH = 0.019, 0.4, 0.16


def landing_shots(*, lateral=True, speeds=True, ricochet=False, bent=0.0, pitches=(-4, 0, 4), each=12):
    """Shots onto the ground by a simple flight whose settings are `bent` away from any muzzle."""
    from archerfish.identification.muzzle.landing import landing_distance

    rng = np.random.default_rng(6)
    pitch = np.radians(np.repeat(pitches, each).astype(float))
    speed = 18 + 0.3 * rng.standard_normal(pitch.size)
    height = HEIGHT + LENGTH * np.sin(pitch)
    distance = landing_distance(speed, pitch + 0.005 * rng.standard_normal(pitch.size), height, DRAG)
    distance *= 1 + bent * (pitch == 0)
    if ricochet:
        distance[3] *= 0.4
    aside = 0.004 * distance * rng.standard_normal(pitch.size) if lateral else None
    return Shots(pitch, 0 * pitch, distance, speed if speeds else None, aside, "shots.csv")


def told(shots):
    result = identify_muzzle(shots, drag=DRAG, height=HEIGHT, length=LENGTH)
    verdict = muzzle_verdict(shots, result)
    return verdict, muzzle_page(shots, result, replace(result.muzzle, provenance={"seed": 0}), verdict, "muzzle")


def test_a_good_set_needs_nothing_more():
    verdict, page = told(landing_shots(each=25))
    assert re.match(
        r"muzzle: 1[78]\.\d+±0\.\d+ m/s, scatter [\d.]+ cm in height and [\d.]+ cm to the side at 3 m; all 75",
        verdict.headline,
    )
    assert verdict.headline.endswith("the flight model fits")
    assert (verdict.fits, verdict.doubts, verdict.next_steps) == (True, (), ())
    assert page.index(verdict.headline) < page.index("What is known") < page.index("Where the shots went")
    assert "No shot was left out." in page


def test_the_page_stands_alone():
    _, page = told(landing_shots())
    assert "<script" not in page
    assert not re.search(r'(src|href)="(?!#)', page)
    assert page.count("<svg") == 2
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))


def test_every_parameter_has_its_unit_and_interval():
    _, page = told(landing_shots())
    for label, unit in (("muzzle speed", "m/s"), ("pitch offset", "°"), ("yaw offset", "°")):
        row = re.search(rf"<th>{label}</th><td[^>]*>−?[\d.]+ {unit}</td><td>−?[\d.]+ … −?[\d.]+ {unit}</td>", page)
        assert row, label
    assert re.search(r"<th>drag</th><td[^>]*>0.019 1/m</td><td>given</td>", page)
    assert re.search(r"<th>from pivot to muzzle</th><td[^>]*>0.16 m</td><td>given</td>", page)


def test_what_was_left_out_is_listed_with_how_far_it_is_off():
    verdict, page = told(landing_shots(ricochet=True))
    assert "35 of 36 shots used" in verdict.headline
    assert re.search(r"<tr><th>shot 4</th><td>-4° pitch</td><td>[\d.]+</td><td>[\d.]+</td>\s*<td>−\d+</td></tr>", page)


def test_a_flight_that_does_not_fit_is_the_first_thing_said():
    verdict, page = told(landing_shots(bent=0.06))
    assert "the flight model does not fit" in verdict.headline
    assert not verdict.fits
    assert "--estimate-drag" in verdict.next_steps[0]
    assert page.index('class="warning"') < page.index("What is known")


@pytest.mark.parametrize(
    ("options", "step"),
    [
        ({"speeds": False}, "Measure the speed of each shot"),
        ({"lateral": False}, "Measure how far left or right"),
        ({"pitches": (-2, 2)}, "three to five pitch settings"),
        ({"each": 6}, "some twenty times at each setting; the least used one has 6"),
    ],
)
def test_what_is_missing_is_what_to_record_next(options, step):
    verdict, _ = told(landing_shots(**options))
    assert any(step in each for each in verdict.next_steps)


def test_without_lateral_distances_the_side_is_not_known():
    verdict, page = told(landing_shots(lateral=False))
    assert "to the side" not in verdict.headline
    assert page.count("<svg") == 1
    assert "so only the distance is drawn" in page
    assert re.search(r"<th>yaw offset</th><td[^>]*>not known</td>", page)
