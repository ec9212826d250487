"""Tasks: names and files, cells and their streams, and how engagements are drawn."""

import contextlib
import json

import numpy as np
import pytest

from archerfish2.errors import InputError
from archerfish2.evaluation.suites import draw
from archerfish2.paper.conditions import assumed_conditions
from archerfish2.task import Task

FAULTS = {
    "period_s = 0": "field period_s: expected float >= 0.0001, got 0",
    "ranges_m = [[2, 1]]": "ranges_m and lengths_s: expected the smaller one first",
    "lenghts_s = [1]": "Unexpected keyword argument 'lenghts_s'; fields are name, motion, ranges_m, lengths_s,",
    'motion = "strfe"': "field motion: expected one of paper, static,",
    'motion = "./mine.py:Mine"': "code that only a file names is not run",
    "ranges_m = " + 9999 * "[": "recursion",
}


def test_the_defaults_are_the_papers_assumed_conditions() -> None:
    c = assumed_conditions()
    place = {"lateral_m": c.max_lateral_offset, "height_m": c.armor_height, "start": (c.start_pitch, c.start_yaw)}
    shape = {"curvature_1_m": c.parabola_curvature, "rise_m": c.parabola_rise, "max_speed_m_s": c.max_lateral_speed}
    times = {"period_s": c.control_period_s, "lengths_s": (c.engagement_s,), "hit_radius_m": c.hit_radius}
    assert Task.load("paper") == Task(motion="paper", name="paper", ranges_m=c.range_bins, **place, **shape, **times)
    assert Task() == Task.load("any") == Task(name="any", motion="any", lengths_s=(1.0, 3.0))


def test_cells_have_the_tables_and_streams_of_their_place() -> None:
    paper, alone = Task.load("paper").cells(), [*Task.load("static").cells(), *Task.load("dynamic").cells()]
    assert [each[:2] for each in paper] == [("II", "static")] * 4 + [("III", "dynamic")] * 4
    assert [each.stream for each in paper] == [each.stream for each in alone] == list(range(8))
    cells, strafe = (Task.load(each).replace(ranges_m=((2, 3), (4, 5))).cells() for each in ("any", "strafe"))
    assert [(each.stream, each.decisions) for each in cells[:3]] == [(0, 50), (1, 50), (4, 50)]
    assert [each[:6] for each in strafe] == [each[:6] for each in (*cells[6:8], *cells[22:24])]


def test_draws_don_t_depend_on_the_cells_beside_them() -> None:
    cells = Task.load("paper").cells()
    (joined, normals), (alone, noise) = draw(cells, 4, 3, "tuning", 6, 5), draw(cells[5:6], 4, 3, "tuning", 6, 5)
    vertex = joined.target.motion.vertex
    assert (normals.shape, normals.dtype, vertex.dtype, set(joined.plant)) == ((32, 50, 6), "f4", "f4", set(range(5)))
    np.testing.assert_array_equal(normals[20:24], noise)
    np.testing.assert_array_equal(vertex[20:24], alone.target.motion.vertex)
    np.testing.assert_array_equal(joined.target.motion.speed > 0.0, np.arange(32) >= 16)
    np.testing.assert_array_equal(np.floor(vertex[:, 0]), np.tile(np.repeat([1, 2, 3, 4], 4), 2))


def test_lengths_of_a_training_are_drawn_apart_from_what_stands_still() -> None:
    scenario = Task(motion="paper", lengths_s=(1.0, 3.0), still_share=0.3).scenario()
    uniforms = np.full((1000, scenario.uniforms), 0.5, np.float32)
    uniforms[:, 4] = (np.arange(1000) + 0.5) / 1000
    short = scenario.draw(uniforms).duration == 1.0
    assert [np.mean(short[:300]), np.mean(short)] == pytest.approx([0.75, 0.75])


def test_a_file_keeps_a_task(tmp_path) -> None:
    task = Task.load("strafe").replace(name='Läufer "1"', ranges_m=[[2, 3.5]], lengths_s=(0.5,), start=(0.1, -0.2))
    task.save(tmp_path / "task.toml")
    assert Task.load(tmp_path / "task.toml") == task


@pytest.mark.parametrize(("text", "problem"), FAULTS.items())
def test_what_a_file_has_wrong_is_named_in_one_line(tmp_path, text, problem) -> None:
    (tmp_path / "task.toml").write_text(text)
    with pytest.raises(InputError) as error:
        Task.load(tmp_path / "task.toml")
    assert str(error.value).startswith(f"{tmp_path / 'task.toml'}: ")
    assert problem in str(error.value).partition("\n")[0]


@pytest.mark.parametrize("count", [60, pytest.param(400, marks=pytest.mark.slow)])
def test_any_mutated_file_is_a_task_or_refused_in_one_line(tmp_path, mutations, accepted, count):
    path = tmp_path / "mine.toml"
    Task.load("paper").save(path)
    fields = dict(line.split(" = ", 1) for line in path.read_text().splitlines())
    as_json = ("{" + ", ".join(f'"{name}": {value}' for name, value in fields.items()) + "}").encode()
    for number, content in enumerate(mutations(as_json, count, 2)):
        with contextlib.suppress(ValueError, AttributeError, RecursionError):  # what is no object stays as it is
            lines = [f"{name} = {json.dumps(value)}" for name, value in json.loads(content).items()]
            content = "\n".join(lines).encode("utf-8", "surrogatepass")
        path.write_bytes(content if number % 2 else content[: len(content) - number])
        task = accepted(lambda: Task.load(path))
        if task is not None:
            task.save(path)
            assert Task.load(path) == task
