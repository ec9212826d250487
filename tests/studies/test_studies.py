"""Studies: what they store, their report, and the figures of the paper."""

import itertools
import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

import archerfish as af
from archerfish.cli.report import WriteReport
from archerfish.cli.transfer import Transfer
from archerfish.evaluation import tables
from archerfish.evaluation.results import Cell, Results
from archerfish.identification.simulation import simulate
from archerfish.logs.recording import Recording
from archerfish.reports.table import Estimate
from archerfish.studies import transfer as transfer_module
from archerfish.studies.paper_figures import figure_4, recorded_step, table_1
from archerfish.studies.report import INTRODUCED, drops
from archerfish.studies.reproduce import BASELINES, learning_curves, paper_evaluations, paper_trainings
from archerfish.studies.study import Study
from archerfish.studies.transfer import COMPARED, check_settings

NAMES = ("policy", "kalman", "parabola-lq")


def cell(world, limit, motion, place, name, draws):
    """Return a cell of three engagements with random hits."""
    kinds = {"policy": "policy", "six-numbers": "policy"}
    tables = {"paper": {"static": "II", "dynamic": "III"}, "virtual infantry": {"static": "IV", "dynamic": "V"}}
    return Cell(
        world=world,
        command_limit=limit,
        length_s=1.0,
        motion=motion,
        range_m=(place + 1.0, place + 2.0),
        stream=place + 4 * (motion == "dynamic"),
        controller=name,
        seed=0 if name in kinds else None,
        kind=kinds.get(name, "classical"),
        table=tables.get(world, {}).get(motion),
        hits_by_engagement=draws.integers(25, 51, 3).tolist(),
        decisions_each=50,
        withheld=0,
    )


@pytest.fixture(scope="module")
def study():
    draws, worlds = (
        np.random.default_rng(0),
        {"paper": ("gate", "box"), "infantry": ("gate",), "virtual infantry": ("gate",)},
    )
    cells = [
        cell(world, limit, motion, place, name, draws)
        for world, limits in worlds.items()
        for limit, motion, place, name in itertools.product(limits, ("static", "dynamic"), range(4), NAMES)
    ]
    task = af.Task.load("paper")
    results = Results(
        seed=0, commit="c", versions={}, tasks=(task,), robots={}, tuning={}, cells=cells, durations={"evaluation": 1.0}
    )
    landings, muzzle = table_1()
    return Study(
        results=results,
        robot="infantry",
        virtual="virtual infantry",
        parts={"yaw": {"usable": False, "headline": "order 3"}},
        steps=[{"source": "paper", "axis": "yaw", "size_deg": 10, "time_s": [0, 1], "measured_deg": [0, 10],
                "model_deg": [0, 9], "fit_percent": 90.0}],
        landings=landings,
        muzzle=muzzle,
        curves=[
            {"targets": targets, "seed": 0, "decisions": [1, 2], "mean_reward": [-0.1, -0.05]}
            for targets in ("dynamic", "static")
        ],
        durations={"training": 60.0},
    )  # fmt: skip


def test_every_rate_of_the_report_is_that_of_the_stored_hits(study, tmp_path):
    study.save(tmp_path / "results.json")
    stored = json.loads((tmp_path / "results.json").read_text())["results"]["cells"]
    rates = {}
    for cell in stored:
        shots = len(cell["hits_by_engagement"]) * cell["decisions_each"]
        place = cell["world"], cell["command_limit"], cell["motion"], cell["controller"]
        rates.setdefault(place, []).append(100 * sum(cell["hits_by_engagement"]) / shots)
    found = 0
    for table in Study.load(tmp_path).report.tables:
        if match := re.match(r".*(static|dynamic) targets: (.*), limit (\w+), engagements", table.title):
            motion, world, limit = match.groups()
            for name, *entries in table.rows:
                if (place := (world, limit, motion, name)) in rates:
                    expected = [*rates[place], np.mean(rates[place])]
                    assert_allclose([entry.value for entry in entries], expected)
                    found += len(entries)
    assert found == 4 * 2 * 5 * len(NAMES)


def test_drops_are_of_the_same_engagements_and_are_in_the_report(study):
    lost = drops(study.results.cells, "infantry", "virtual infantry")
    assert len(lost) == 8 * len(NAMES)
    for pair in lost:
        label = pair.controller, pair.motion, pair.range_m
        own = [one for one in study.results.cells if (one.controller, one.motion, one.range_m) == label]
        simulated, shot = (next(one for one in own if one.world == world) for world in ("infantry", "virtual infantry"))
        assert pair.difference == pytest.approx((simulated.hits - shot.hits) / simulated.decisions)
    table = next(table for table in study.report.tables if table.title.startswith("Drop in points"))
    mean = tables.mean([pair for pair in lost if pair.controller == "kalman"])
    assert next(row for row in table.rows if row[0] == "kalman")[3] == mean
    assert isinstance(mean, Estimate)
    assert [row[0] for row in table.rows] == list(NAMES)
    largest = max(pair.difference for pair in lost if pair.controller == "kalman")
    assert next(row for row in table.rows if row[0] == "kalman")[4].value == pytest.approx(100 * largest)


def test_the_report_says_who_is_who_what_is_printed_and_what_is_in_doubt(study, tmp_path):
    report = study.report
    assert re.match(r"On virtual infantry the policy hits with [\d.]+.% \(.*\) of all shots at moving", report.headline)
    assert "points against kalman, the best controller that has only measurements" in report.headline
    titles = [table.title.partition(":")[0] for table in report.tables]
    assert titles[1:4] == ["Table IV, static targets", "Table V, dynamic targets", "Drop in points"]
    assert "Table II, static targets" in titles
    assert "Table I" in titles
    controllers = report.tables[0].rows
    assert controllers == tuple((name, INTRODUCED[name]) for name in NAMES)
    assert "yaw was used, though not usable: order 3" in report.doubts
    assert [row[:2] for row in report.tables[1].rows if "PPO" in row[0]] == [("paper: PPO (printed)", "78.00")]
    report.write_page(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert page.count("<svg") == len(report.figures) == 7
    assert [caption[:6] for caption, _ in report.figures[-2:]] == ["Fig. 5", "Fig. 6"]
    assert re.findall(r'(?:src|href)="(?!#)', page) == []


def test_the_report_names_the_least_share_of_the_bound_and_whose_muzzle_is_assumed(study):
    bounded = [one.replace(bound=1.0, bound_error=0.0) if one.world == "paper" else one for one in study.results.cells]
    facts = {"robot": "infantry", "muzzle": "18 m/s"}
    robots = {"infantry": facts, "virtual infantry": {**facts, "world": "module:World"}}
    known = study.replace(results=study.results.replace(cells=bounded, robots=robots)).report.known
    for limit in ("gate", "box"):
        own = [one for one in bounded if (one.world, one.command_limit, one.controller) == ("paper", limit, "policy")]
        least = 100 * min(sum(one.hits_by_engagement) / (3 * 50) for one in own)
        said = f"The policy has at least {least:.1f}\u00a0% of the bound in every cell (paper, limit {limit}"
        assert [line for line in known if line.startswith(said)] != []
    assert {"Muzzle of infantry: 18 m/s.", "Muzzle that controllers assume on virtual infantry: 18 m/s."} <= {*known}


def test_a_robot_of_one_s_own_has_a_report_without_the_paper(study):
    own = [one for one in study.results.cells if one.world != "paper"]
    own = study.results.replace(cells=[one.replace(table=None) for one in own])
    text = str(study.replace(results=own, landings=(), curves=(), steps=()).report)
    assert text.startswith("Archerfish: the robot infantry\n")
    assert "paper" not in text.replace("task paper", "").replace("Task paper", "").replace("paper's baseline", "")


def test_the_command_writes_the_page_again_and_names_what_is_no_result(study, tmp_path, refused):
    study.save(tmp_path / "results.json")
    assert WriteReport(tmp_path).run().where == f"open {tmp_path / 'report.html'}"
    (tmp_path / "other.json").write_text("{}")
    refused(r'other.json: field schema: expected "archerfish.results/4" or', WriteReport(tmp_path / "other.json").run)


@pytest.mark.slow
def test_the_printed_axes_are_identified_from_their_logs(tmp_path):
    response = figure_4("yaw", tmp_path, 0)
    assert response.fit_percent > 99.5
    names = {path.stem for path in tmp_path.glob("*.csv")}
    assert names == {"yaw_sweep", "yaw_step", "yaw_step_validation"}
    assert af.PlantRecord.load(tmp_path / "yaw.json").axis == "yaw"


def test_table_1_has_the_printed_points_and_a_model_that_misses_them_by_six_percent():
    points, muzzle = table_1()
    errors = [point.model_m / point.measured_m - 1.0 for point in points]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(0.0623, abs=5e-4)
    assert [(point.pitch_deg, point.yaw_deg) for point in points][:2] == [(5.0, 5.0), (5.0, 0.0)]
    assert muzzle["drag_per_m"] == 0.019


def test_a_recorded_step_is_compared_with_its_model_from_the_step_on(tmp_path):
    plant = af.PlantRecord.second_order(5.0, 0.7).replace(axis="yaw")
    command = np.concatenate([np.zeros(100), np.full(900, 0.2)])
    angle = simulate(plant, command[:, None])[:, 0] + 0.01
    Recording.from_arrays(command, angle, 0.001).write_csv(tmp_path / "step.csv")
    step = recorded_step("yaw", tmp_path / "step.csv", plant)
    assert step.fit_percent == pytest.approx(100.0, abs=1e-3)
    assert (step.size_deg, step.time_s[:2], len(step.time_s)) == (pytest.approx(11.459), (0.0, 0.005), 180)


def test_trainings_and_evaluations_are_those_of_the_paper_s_tables(tmp_path):
    jobs = paper_trainings(tmp_path, 3, quick=False)
    assert [job.name for job in jobs[:2]] == ["gate-policy", "gate-six-numbers"]
    assert len(jobs) == 3 * 2 + 2 * 3
    assert {job.arguments["seed"] for job in jobs} == {3, 4, 5}
    evaluations = paper_evaluations(tmp_path, 500, 3)
    assert len(evaluations) == 2 * (len(BASELINES) + 2) + 2
    assert set(COMPARED) < set(BASELINES) <= INTRODUCED.keys()
    for name, seed in itertools.product(("static", "dynamic"), (0, 1)):
        folder = tmp_path / f"{name}-curve-{seed}"
        folder.mkdir()
        (folder / "log.jsonl").write_text('{"decisions": 10, "mean_reward": -0.2}\n' * 2)
    curves = learning_curves(tmp_path)
    found = [(curve.targets, curve.seed) for curve in curves]
    assert found == [*itertools.product(("dynamic", "static"), (0, 1))]
    assert curves[0].mean_reward == (-0.2, -0.2)


def test_settings_of_a_study_are_checked_before_the_work(refused, tmp_path):
    refused("seeds must be one or more different whole numbers from 0 on, got \\[1, 1\\]", check_settings, (1, 1), 2, 1)
    refused("engagements must be at least 2, got 1; choose more", check_settings, (1,), 1, 1)
    refused("workers must be at least 1, got -1; choose more", Transfer(workers=-1, out=tmp_path / "out").run)
    refused("no robot 'infantri'", Transfer(robot="infantri", out=tmp_path / "out").run)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_robot_goes_from_logs_to_hit_rates(monkeypatch, tmp_path):
    pytest.importorskip("mujoco")
    monkeypatch.setattr(transfer_module, "QUICK_STEPS", 40_000)
    ending = Transfer(quick=True, engagements=2, out=tmp_path / "out").run("--quick")
    study = Study.load(tmp_path / "out")
    assert {cell.controller for cell in study.results.cells} == {*COMPARED, "policy", "six-numbers"}
    assert (study.robot, study.virtual, study.quick) == ("infantry", "virtual infantry", True)
    assert len(study.steps) == 6
    own = af.identify_robot(tmp_path / "out" / "logs", name="infantry", seed=0).record
    assert own.digest() == af.Robot.load(tmp_path / "out" / "robot").digest()
    again = af.evaluate(tmp_path / "out" / "policies" / "policy-0", tmp_path / "out" / "robot", "paper", engagements=2)
    expected = [cell.hits for cell in study.results.cells if (cell.world, cell.controller) == ("infantry", "policy")]
    assert [cell.hits for cell in again.cells] == expected
    assert ending.then.startswith("archerfish evaluate")
