import numpy as np
import pytest
from scipy.io import loadmat

from archerfish.identification.excitation import linear_sweep, step
from archerfish.identification.gimbal import identify_axis
from archerfish.identification.state_space import plant_poles, simulate
from archerfish.identification.validation import fit_percent, free_run
from archerfish.paper.gimbal import printed_plants
from archerfish.records.errors import InputError
from archerfish.records.plant import dc_gain
from archerfish.records.recording import make_recording, slice_recording


def halves(inputs, output):
    inputs = inputs.reshape(len(inputs), -1)
    names = [f"u{index}" for index in range(inputs.shape[1])]
    whole = make_recording(inputs, output, 0.01, input_names=names)
    middle = len(whole) // 2
    return slice_recording(whole, 0, middle), slice_recording(whole, middle, len(whole))


@pytest.mark.parametrize(("delay", "feedthrough"), [(0, 0.0), (5, 0.0), (2, 0.6)])
def test_a_clean_recording_gives_plant_delay_and_feedthrough_back(white, resonant_plant, record, delay, feedthrough):
    plant = resonant_plant(delay, feedthrough)
    result = identify_axis([record(plant, white[:, 0], offset=4.0)])
    assert result.plant.delay_samples == delay
    np.testing.assert_allclose(plant_poles(result.plant), plant_poles(plant), atol=1e-4)
    np.testing.assert_allclose(result.plant.D, plant.D, atol=1e-6)
    np.testing.assert_allclose(dc_gain(result.plant), dc_gain(plant), rtol=1e-4)
    assert result.offset == pytest.approx(4.0, abs=1e-3)


def test_two_inputs_share_the_poles(white, resonant_plant, record):
    plant = resonant_plant(inputs=2)
    result = identify_axis([record(plant, white, noise=0.02)])
    fresh = np.random.default_rng(5).standard_normal((400, 2))
    assert fit_percent(simulate(plant, fresh), simulate(result.plant, fresh)).item() > 98
    assert result.plant.input_names == ("u0", "u1")


def test_noise_is_reported_as_it_is(white, resonant_plant, record):
    recording = record(resonant_plant(), white[:, 0], noise=0.05)
    result = identify_axis([recording])
    assert result.fit_percent[0] == pytest.approx(95, abs=0.5)
    assert result.residual_sd == pytest.approx(0.05 * recording.outputs.std(), rel=0.1)


@pytest.mark.parametrize("axis", ["pitch", "yaw"])
def test_the_printed_axes_are_found_from_a_sweep_and_a_step_at_one_percent_noise(axis, record):
    true = printed_plants()[axis]
    signals = [linear_sweep(10.0, 1e-3), step(1.0, 1e-3)]
    logs = [record(true, signal, noise=0.01, seed=seed) for seed, signal in enumerate(signals)]
    result = identify_axis(logs, axis=axis)
    for signal in signals:
        clean = simulate(true, signal[:, None])
        assert fit_percent(clean, simulate(result.plant, signal[:, None])).item() >= 99.6
    slowest = plant_poles(true)[np.argmin(np.abs(plant_poles(true) - 1))]
    assert np.abs(result.poles - slowest).min() < 5e-4
    np.testing.assert_allclose(dc_gain(result.plant), dc_gain(true), rtol=2e-3)
    assert any("say little about it" in remark for remark in result.remarks)
    assert np.abs(result.poles).max() < 1


@pytest.mark.parametrize(
    ("name", "inputs", "output", "bar"),
    [("robot_arm_dat", [0], 1, 96.3), ("CD_player_arm_dat", [0, 1], 3, 84.0)],
)
def test_real_arms_are_foretold_on_the_unseen_half(shared_data, name, inputs, output, bar):
    table = loadmat(shared_data / "identification" / "slicot_sysid" / f"{name}.mat")[name]
    train, test = halves(table[:, inputs], table[:, output])
    result = identify_axis([train])
    assert free_run(result.plant, test, result.offset).fit_percent.item() >= bar


def test_a_real_hair_dryer_is_foretold_on_the_unseen_half(shared_data):
    table = np.loadtxt(shared_data / "identification" / "rgp" / "dryer.dat")
    train, test = halves(table[:, 0], table[:, 1])
    result = identify_axis([train])
    assert free_run(result.plant, test, result.offset).fit_percent.item() >= 86.5


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_other_orders_give_plants_of_that_order(white, resonant_plant, record, order):
    result = identify_axis([record(resonant_plant(), white[:, 0], noise=0.05)], order=order, max_delay=2)
    assert result.plant.A.shape == (order, order)
    assert np.abs(result.poles).max() < 1


def test_too_short_a_recording_is_refused(white, resonant_plant, record):
    with pytest.raises(InputError, match="too few for order 4"):
        identify_axis([record(resonant_plant(), white[:60, 0])])


def test_a_negative_delay_is_refused(white, resonant_plant, record):
    with pytest.raises(InputError, match="max_delay must be at least 0, got -1"):
        identify_axis([record(resonant_plant(), white[:, 0])], max_delay=-1)
