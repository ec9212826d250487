"""One axis of a given order on recorded logs: within 0.3 points of the fits that the first edition stored."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import io

from archerfish2.identification.axis.fit import fit_axis
from archerfish2.identification.simulation import free_run, simulate
from archerfish2.logs.log import read_log
from archerfish2.logs.recording import Recording
from archerfish2.paper.gimbal import printed_plants

SHARED = "shared/data/identification"
DATA = next((each / SHARED for each in Path(__file__).parents if (each / SHARED).is_dir()), None)
POINTS = 0.3


def flexible_structure():
    table = io.loadmat(DATA / "slicot_sysid" / "flexible_structure_dat.mat")["flexible_structure_dat"]
    return table[:, [0, 1]], table[:, [2]]


def cascaded_tanks():
    found = io.loadmat(DATA / "drgp_vss" / "cascaded.mat")
    return found["X"].reshape(-1, 1).astype(float), found["y"].reshape(-1, 1).astype(float)


REAL = {"flexible structure": (flexible_structure, 51.73, 56.59), "cascaded tanks": (cascaded_tanks, 67.16, 81.29)}


@pytest.mark.skipif(DATA is None, reason=f"no folder {SHARED} with recorded logs beside the clone")
@pytest.mark.parametrize("name", REAL)
def test_half_of_a_log_predicts_the_other_as_well_as_in_the_first_edition(name):
    read, test, training = REAL[name]
    u, y = read()
    half = len(y) // 2
    u, y = u - u[:half].mean(0), y - y[:half].mean(0)
    names = tuple(f"u{number}" for number in range(u.shape[1]))
    found = fit_axis([Recording.from_arrays(u[:half], y[:half], 0.01, input_names=names)], 4)
    known = free_run(found.plant, u[:half], y[:half])
    fits = known.fit_percent.item(), free_run(found.plant, u[half:], y[half:], known.offset).fit_percent.item()
    assert_allclose(fits, (training, test), atol=POINTS)


INFANTRY = {"pitch": (1.0291, 95.99, 98.61), "yaw": (1.0002, 96.34, 99.13)}  # steady gain, sweep and step held back


@pytest.mark.parametrize("axis", INFANTRY)
def test_the_axes_of_a_robot_predict_logs_that_were_held_back(axis, lab_folder):
    def read(name):
        return read_log(lab_folder / f"{axis}_{name}.csv").recordings

    gain, *fits = INFANTRY[axis]
    found = fit_axis([*read("sweep"), *read("step")], 2)
    assert_allclose(found.plant.dc_gain, gain, rtol=0.01)
    for name, fit in zip(("sweep_validation", "step_validation"), fits, strict=True):
        (each,) = read(name)
        assert_allclose(free_run(found.plant, each.inputs, each.outputs).fit_percent, fit, atol=POINTS)


@pytest.mark.parametrize("axis", ["pitch", "yaw"])
def test_a_sweep_and_a_step_under_noise_give_the_step_response_of_a_printed_axis(axis):
    true, rng, time = printed_plants()[axis], np.random.default_rng(0), 1e-3 * np.arange(10_000)
    step = (time[:1000] >= 0.05).astype(float)
    clean = {u.size: (u, simulate(true, u[:, None])) for u in (np.sin(2 * np.pi * (2 * time + 2.4 * time**2)), step)}
    logs = [
        Recording.from_arrays(u, y + 0.01 * y.std() * rng.standard_normal(y.shape), 1e-3) for u, y in clean.values()
    ]
    error = clean[1000][1] - simulate(fit_axis(logs, 4).plant, step[:, None])
    assert 100 * (1 - np.linalg.norm(error) / np.linalg.norm(clean[1000][1] - clean[1000][1].mean())) >= 99.85
