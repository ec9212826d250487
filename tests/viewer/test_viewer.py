"""The viewer: its trials against rollouts, the film against a rollout, who may reach the page, and what is refused."""

import http.client
import json
import re
import socket
from pathlib import Path

import numpy as np
import pytest

from archerfish.cli.main import main
from archerfish.controllers.registry import make_controller
from archerfish.controllers.tuning import entry, keep
from archerfish.evaluation.rollout import rollout, run_engagements
from archerfish.protocols import Engagement
from archerfish.robot import Robot
from archerfish.simulation.world import make_world
from archerfish.targets import motion
from archerfish.task import Task
from archerfish.viewer.choice import chosen_robot, chosen_task, first_choice, make_setup
from archerfish.viewer.film import ellipse
from archerfish.viewer.hand import HandRun
from archerfish.viewer.trial import moment, run_trial

INFANTRY = Path(__file__).parents[1] / "infantry"


@pytest.fixture(scope="module")
def setup():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ARCHERFISH_CACHE", "off")  # where somebody may have tuned kalman
        yield make_setup(Robot.paper(), Task.of("any"), ["kalman"])


def rolled(setup, choice, robot=None):
    """Return the rollout of a choice by the public verb, which compiles where it can."""
    task, words = chosen_task(setup, choice), {"engagements": choice.engagements, "seed": choice.seed}
    return rollout("kalman", robot or setup.robot, task, tuning="start", **words)


def test_a_trial_is_the_rollout_of_robot_and_task_as_chosen(setup):
    choice = first_choice(setup, engagements=4, seed=3, distance=2.0, dispersion=2.0, speed=1.0)
    trial, shots = run_trial(setup, choice), rolled(setup, choice, chosen_robot(setup, choice))
    np.testing.assert_allclose(trial.miss, shots.shot.miss, atol=3e-4)
    np.testing.assert_allclose(trial.angle[:, 1:], shots.shot.angle, atol=1e-4)
    np.testing.assert_allclose(trial.place[:, 1:51], shots.target, atol=1e-6)
    spread = np.array([setup.robot.muzzle.pitch_sd, setup.robot.muzzle.yaw_sd])
    np.testing.assert_allclose(ellipse(trial, 2.0), 2.448 * 2.0 * 2.0 * spread, rtol=1e-3)  # χ² of 2: 5.991 = 2.448²
    assert trial.motions == ("still", "parabola", "pass", "strafe")
    assert not np.allclose(trial.miss, rolled(setup, choice).shot.miss, atol=1e-2)  # half the dispersion
    late = run_trial(setup, first_choice(setup, motion="circle", command_latency=0.08, camera_latency=0.03))
    assert late.hits.sum() < 0.8 * run_trial(setup, first_choice(setup, motion="circle")).hits.sum()


def test_a_pellet_flies_from_the_muzzle_to_where_it_was_scored():
    setup = make_setup(Robot.load(INFANTRY), Task.of("dynamic"))
    assert {"oracle", "kalman"} <= setup.controllers.keys() and "kalman-paper" not in setup.controllers
    trial = run_trial(setup, first_choice(setup, controller="oracle", engagements=2))
    fired_at, flight = trial.fired_at[30], trial.flight_time[1, 30]
    length = float(trial.muzzle.length)
    assert np.linalg.norm(moment(trial, 1, fired_at + 1e-6).pellets[-1]) == pytest.approx(length, abs=1e-3)
    before, after = (moment(trial, 1, fired_at + flight + offset) for offset in (-1e-6, 1e-6))
    np.testing.assert_allclose(before.pellets[0] - before.place, [0.0, *trial.miss[1, 30]], atol=1e-3)
    assert len(after.misses) == len(before.misses) + 1
    np.testing.assert_array_equal(after.misses[-1], trial.miss[1, 30])


def test_shots_at_a_dragged_target_are_those_at_a_target_whose_path_is_known(setup):
    choice = first_choice(setup, motion="dragged by hand", speed=1.0, seed=4)
    run = HandRun(setup, choice, np.array([3.0, 0.0, 0.0]))
    assert run.trial().hit.shape == (1, 0)
    for _ in range(130):
        run.step(np.array([2.5, 0.5, -9.0]))
    trial, period = run.trial(), np.full(1, setup.task.period_s, np.float32)
    np.testing.assert_allclose(trial.place[0, -1], [2.5, 0.5, -0.3], atol=0.05)  # no lower than a target may be
    assert np.linalg.norm(np.diff(trial.place[0], axis=0), axis=1).max() <= 1.0 * 0.02 + 1e-9
    places = trial.place.astype(np.float32)
    target = motion.disc(motion.Path(places, 0.0 * period, period), places[:, 0])
    engagement = Engagement(target, np.zeros((1, 2), np.float32), np.zeros(1, np.int32), 130 * period)
    world = make_world(setup.robot, setup.task)
    drawn = np.random.default_rng([4, 73]).standard_normal((131, world.normals))[1:, None].astype(np.float32)
    controller = make_controller("kalman", setup.robot, setup.task)
    known = run_engagements(world, controller, engagement, np.moveaxis(drawn, 0, 1), may_compile=False)
    judged = np.isfinite(trial.error[0, :, 0])
    assert 110 <= judged.sum() < 130
    np.testing.assert_allclose(trial.miss[0, judged], known.shot.miss[0, judged], atol=1e-5)
    np.testing.assert_array_equal(trial.hit[0, judged], known.hit[0, judged])
    assert 10 < trial.hits[0] < 100


def test_the_film_is_one_complete_file_with_the_positions_of_the_rollout(tmp_path, setup, capsys):
    path = tmp_path / "film.html"
    words = ["view", "--controller", "kalman", "--engagements", "4", "--seed", "5", "--export", str(path)]
    main(words)
    main(words)  # its own film is replaced
    assert f"open {path}" in capsys.readouterr().out
    page = path.read_text()
    assert not re.findall(r"""(?:src|href)=|https?:|@import|url\(""", page)
    film = json.loads(re.search(r'<script type="application/json" id="film">(.*?)</script>', page)[1])
    shots = rolled(setup, first_choice(setup, engagements=4, seed=5))
    played = film["engagements"]
    np.testing.assert_allclose([each["plate"][1:51] for each in played], shots.target, atol=1e-5)
    np.testing.assert_allclose([each["gimbal"][1:] for each in played], shots.shot.angle, atol=1e-4)
    np.testing.assert_array_equal([each["hit"] for each in played], shots.hit)
    assert "kalman is NOT tuned" in film["text"]


def test_a_classical_controller_has_the_tuning_that_is_kept_beside_the_robot(tmp_path):
    folder, task = tmp_path / "robot", Task.of("strafe")
    Robot.load(INFANTRY).save(folder)
    robot = Robot.load(folder)
    before = make_setup(robot, task)
    assert "NOT tuned" in before.note("kalman") and before.note("oracle") == ""
    begun = entry("kalman", robot, task)
    keep(begun.replace(tuning=begun.tuning.replace(extra_lead_s=0.06)), robot)
    after = make_setup(robot, task)
    assert "NOT" not in after.note("kalman") and "NOT tuned" in after.note("kalman-lq")
    choice = first_choice(after, controller="kalman")
    assert not np.array_equal(run_trial(after, choice).miss, run_trial(before, choice).miss)


def test_bad_input_ends_with_one_line_and_status_2(tmp_path, setup, capsys, monkeypatch, refused):
    (tmp_path / "mine.html").write_text("<p>mine</p>")
    (tmp_path / "folder.html").mkdir()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        cases = {
            "controller must be one of": ["--controller", "nobody"],
            "distance must be 1…8": ["--distance-m", "20"],
            "engagements must be 2…200": ["--engagements", "1"],
            "seed must be": ["--seed", "-1"],
            "must be 0…65535": ["--port", "65536"],
            "already in use": ["--port", str(taken.getsockname()[1])],
            "was not written by archerfish view": ["--export", str(tmp_path / "mine.html")],
            "is a folder": ["--export", str(tmp_path / "folder.html")],
            "ends with .html": ["--export", str(tmp_path / "film.mp4")],
            "pitch.json": [str(tmp_path / "no-robot")],
        }
        for pattern, words in cases.items():
            with pytest.raises(SystemExit) as end:
                main(["view", *words])
            printed = capsys.readouterr().err
            assert (end.value.code, printed.count("\n"), pattern in printed) == (2, 1, True), printed
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SystemExit, match="2"):
        main(["view"])
    assert "pip install 'archerfish[view]'" in capsys.readouterr().err
    monkeypatch.undo()
    choice = first_choice(setup, controller="oracle", motion="dragged by hand")
    refused("oracle needs the target's path", HandRun, setup, choice, np.array([3.0, 0.0, 0.0]))


def test_no_page_of_somebody_else_reaches_the_page():
    pytest.importorskip("viser", reason="needs viser, the extra view")
    from archerfish.viewer.server import page_server

    def answer(port, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
        connection.putrequest("GET", "/", skip_host=True)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        response = connection.getresponse()
        content, policy = response.read(), response.headers.get("Content-Security-Policy", "")
        connection.close()
        return response.status, b"<html" in content, "frame-ancestors 'none'" in policy

    with page_server(0) as server:
        port = server.get_port()
        own = f"127.0.0.1:{port}"
        assert answer(port, Host=own, Origin=f"http://{own}") == (200, True, True)
        assert answer(port, Host=f"localhost:{port}") == (200, True, True)
        for headers in ({"Host": own, "Origin": "http://evil.example"}, {"Host": f"evil.example:{port}"}, {}):
            assert answer(port, **headers) == (403, False, False)
        assert server.request_share_url() is None
