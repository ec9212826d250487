import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tyro
from rich.console import Console

from archerfish.cli.identify_muzzle import IdentifyMuzzle, run_muzzle
from archerfish.records.errors import InputError
from archerfish.records.muzzle import read_muzzle

ROOT = Path(__file__).parents[2]


@pytest.fixture
def console():
    return Console(record=True, width=100)


def parsed(*words):
    return tyro.cli(IdentifyMuzzle, args=[str(word) for word in words])


@pytest.fixture
def shots(tmp_path):
    rng = np.random.default_rng(0)
    path = tmp_path / "shots.csv"
    rows = [
        f"{pitch},{level + 0.05 * rng.standard_normal():.4f},{18 + 0.2 * rng.standard_normal():.3f}"
        for pitch, level in ((0, 4.8), (2, 6.2))
        for _ in range(10)
    ]
    path.write_text("pitch_deg,distance_m,speed_m_s\n" + "\n".join(rows) + "\n")
    return path


@pytest.fixture
def hits(tmp_path):
    rng = np.random.default_rng(1)
    path = tmp_path / "hits.csv"
    rows = [
        f"0,{plane},{-4.905 * (plane / 18) ** 2 + 0.004 * plane * rng.standard_normal():.4f},"
        f"{0.005 * plane * rng.standard_normal():.4f}"
        for plane in (2, 4, 6)
        for _ in range(15)
    ]
    rows[7] = "0,2,0.6,0.1"
    path.write_text("pitch_deg,plane_distance_m,hit_height_m,lateral_m\n" + "\n".join(rows) + "\n")
    return path


def test_it_writes_record_picture_and_summary(tmp_path, shots, console):
    out = tmp_path / "out"
    summary = run_muzzle(parsed(shots, "--height-m", "0.4", "--out", out), console)
    assert {path.name for path in out.iterdir()} == {
        ".archerfish.json",
        "muzzle.json",
        "muzzle.html",
        "muzzle.svg",
        "muzzle.png",
    }
    muzzle = read_muzzle(out / "muzzle.json")
    assert muzzle.speed == pytest.approx(18.0, abs=0.2)
    assert muzzle.height == 0.4
    assert set(muzzle.provenance["inputs"]) == {"shots.csv"}
    assert len(summary["shots"]) == 20
    assert summary["shots"][3]["place"] == "shots.csv line 5"
    assert "95 % interval" in console.export_text()
    json.dumps(summary)


def test_hits_on_a_plane_are_identified_and_a_ricochet_is_listed_by_its_line(tmp_path, hits, console):
    summary = run_muzzle(parsed(hits, "--out", tmp_path / "out"), console)
    assert summary["parameters"]["speed"] == pytest.approx(18.0, rel=0.1)
    assert "yaw_sd" in summary["intervals_95"]
    assert [shot["place"] for shot in summary["shots"] if not shot["used"]] == ["hits.csv line 9"]
    (finding,) = (each for each in summary["findings"] if each["code"] == "outliers")
    assert "hits.csv line 9" in finding["message"]
    assert "muzzle height" not in console.export_text()


def test_of_shots_at_the_ground_the_length_to_the_muzzle_is_asked_for_until_it_is_given(tmp_path, shots, console):
    told = [
        run_muzzle(parsed(shots, "--height-m", "0.4", *words, "--out", tmp_path / "out"), console)["next_steps"]
        for words in ((), ("--length-m", "0.16"))
    ]
    assert [sum("--length-m" in each for each in steps) for steps in told] == [1, 0]
    assert read_muzzle(tmp_path / "out" / "muzzle.json").length == 0.16
    assert "from pivot to muzzle │ 0.16 m" in " ".join(console.export_text().split())


def test_what_hits_on_a_plane_tell_does_not_depend_on_the_length_to_the_muzzle(tmp_path, hits, console):
    plain, given = (
        run_muzzle(parsed(hits, *words, "--out", tmp_path / "out"), console) for words in ((), ("--length-m", "0.16"))
    )
    assert given["intervals_95"] == plain["intervals_95"]
    assert given["parameters"] == {**plain["parameters"], "length": 0.16}
    assert not any("--length-m" in each for each in plain["next_steps"])


def test_table_1_is_told_not_to_fit(tmp_path, shared_data, console):
    path = shared_data / "robomaster" / "paper_table1_landing.csv"
    command = parsed(path, "--pitch=alpha_deg", "--yaw=beta_deg", "--distance=d_real_m", "--out", tmp_path / "out")
    summary = run_muzzle(command, console)
    text = " ".join(console.export_text().split())
    assert "leaves 6.0 % of the distance (rms over the settings), at worst -8.3 % at 0° pitch" in text
    assert text.count("the flight model does not fit") == 3
    assert "Eq (5) as printed leaves 5.9 %" in text
    assert "lack-of-fit" in {finding["code"] for finding in summary["findings"]}


def test_faults_are_told_and_leave_nothing_behind(tmp_path, shots, console):
    good = IdentifyMuzzle((shots,), out=tmp_path / "out")
    for command, message in [
        (replace(good, shots=()), "no file of shots given"),
        (replace(good, distance="d"), 'no column "d"'),
        (replace(good, estimate_drag=True), "can't separate"),
        (replace(good, shots=(shots, shots)), "repeat shots.csv line 2"),
    ]:
        with pytest.raises(InputError, match=message):
            run_muzzle(command, console)
    assert not (tmp_path / "out").exists()


def test_every_code_is_in_the_documentation():
    sources = [*ROOT.glob("src/archerfish/identification/muzzle/*.py"), *ROOT.glob("src/archerfish/records/shots*.py")]
    text = "\n".join(path.read_text() for path in sources)
    hyphenated = r'"([a-z]+(?:-[a-z]+)+)"'
    raised = set(re.findall(hyphenated, text)) | {"millimetres", "outliers"}
    raised -= {"flat-fire", "eq-5", "utf-8-sig"}
    listed = set(re.findall(r"^\| `([a-z-]+)` \|", (ROOT / "docs/shots.md").read_text(), re.MULTILINE))
    assert raised == {code for code in listed if code not in ("missed",)}
