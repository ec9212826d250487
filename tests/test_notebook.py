"""The ten lines of the front door in a kernel of Jupyter: tables and pictures are inside the outputs."""

from pathlib import Path

import nbclient
import nbformat
import pytest

ROOT = Path(__file__).parents[1]
CELLS = (
    "import archerfish as af\nfrom archerfish.evaluation import run\nrun.has_jax = lambda: False",  # no compilation
    "robot = af.Robot.paper()\nrobot",
    "task = af.Task.load('static').replace(ranges_m=((2.0, 3.0),))\ntask",
    "both = {'ours': 'kalman', 'kalman-lq': 'kalman-lq'}",
    "results = af.evaluate(both, robot, task, engagements=4, tuning='start')\nprint(results)",
    "results",
    "results.compare('ours', 'kalman-lq')",
    "results.plot()",
    "shots = af.rollout('kalman', robot, task, engagements=2, tuning='start')\nshots",
    "shots.plot(0)",
)


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    """Return the outputs of each cell, by its last line."""
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in CELLS])
    folder = {"metadata": {"path": str(tmp_path_factory.mktemp("notebook"))}}
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3", resources=folder).execute()
    return {cell.source.splitlines()[-1]: cell.outputs for cell in notebook.cells}


def test_tables_are_text_of_the_output_itself(outputs):
    printed = outputs["print(results)"]
    text = "".join(output.text for output in printed if output.output_type == "stream")
    assert "ours" in text
    assert "2–3 m" in text
    for last in ("results", "results.compare('ours', 'kalman-lq')"):
        [shown] = [output.data for output in outputs[last] if output.output_type == "execute_result"]
        assert "<table" in shown["text/html"], last
        assert "\x1b" not in shown["text/plain"], last


def test_a_figure_is_a_picture(outputs):
    for last in ("results.plot()", "shots.plot(0)"):
        assert "image/png" in outputs[last][-1].data, last


def test_a_bar_is_one_output_and_what_is_shown_of_an_object_is_short(outputs):
    assert sum(output.output_type == "display_data" for output in outputs["print(results)"]) <= 1
    for last in ("robot", "task", "shots"):
        [shown] = outputs[last]
        assert len(shown.data["text/plain"]) < 500, last


@pytest.mark.slow
def test_the_notebook_of_the_examples_runs_and_draws(tmp_path):
    notebook = nbformat.read(ROOT / "examples" / "notebook.ipynb", 4)
    for cell in notebook.cells:
        cell.source = cell.source.replace("engagements=50", "engagements=4")
    folder = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3", resources=folder).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2
