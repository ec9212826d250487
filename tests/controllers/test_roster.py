import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.controllers.manoeuvring import Manoeuvring
from archerfish.controllers.parabola_filter import ParabolaFilter
from archerfish.controllers.predictors import ConstantVelocity, ParabolaAware, Vertex
from archerfish.controllers.roster import CONTROLLERS, Tuning, make_controller
from archerfish.dynamics.array_namespace import map_arrays
from archerfish.records.errors import InputError
from archerfish.sensing.kalman_filter import INITIAL_SPEED, TrackerNoise

NOISE = TrackerNoise(*(np.asarray(each) for each in (0.0, 1e-3, 1e-3, 0.015, 0.0017)))


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_controller_is_float32_throughout(bench, name) -> None:
    found = []
    map_arrays(found.append, make_controller(name, bench("gate")._replace(noise=NOISE, tuning=Tuning(4.0))))
    assert {np.asarray(each).dtype for each in found if np.asarray(each).dtype.kind == "f"} == {np.dtype(np.float32)}


def test_without_a_record_the_conditions_tell_noise_and_tuning(bench) -> None:
    work = bench("box")
    conditions, controller = work.conditions, make_controller("kalman", work)
    position = conditions.kalman_position_sd
    expected = (conditions.kalman_acceleration_sd, position, position, 0, 0, INITIAL_SPEED)
    assert_allclose(np.array([*controller.predictor.noise], float), expected, rtol=1e-6)
    assert controller.lead == pytest.approx(conditions.control_period_s + conditions.kalman_extra_lead_s)


@pytest.mark.parametrize("name", ["kalman", "kalman-lq"])
def test_a_tracker_believes_the_cameras_record_and_its_tuning(bench, name) -> None:
    tuning = Tuning(4.0, -0.06, initial_speed=0.3, velocity_decay=0.8)
    work = bench("box")._replace(noise=NOISE, tuning=tuning)
    controller = make_controller(name, work)
    assert isinstance(controller.predictor, ConstantVelocity)
    assert_allclose(np.array([*controller.predictor.noise], float), [4.0, 1e-3, 1e-3, 0.015, 0.0017, 0.3], rtol=1e-6)
    assert controller.predictor.velocity_decay == pytest.approx(0.8)
    # A controller that doesn't know the gimbal counts from the decision, one that does from the shot.
    assert controller.lead == pytest.approx((work.conditions.control_period_s if name == "kalman" else 0.0) - 0.06)


def test_interacting_models_suppose_what_they_were_tuned_to(bench) -> None:
    tuning = Tuning(0.5, initial_speed=0.3, smoothing=0.1, turn_rate=2.0)
    controller = make_controller("imm-lq", bench("gate")._replace(noise=NOISE, tuning=tuning))
    assert isinstance(controller.predictor, Manoeuvring)
    assert controller.predictor.rates.turn == pytest.approx(2.0)
    assert_allclose(np.array([*controller.predictor.noise], float), [0.5, 1e-3, 1e-3, 0.015, 0.0017, 0.3], rtol=1e-6)
    assert_allclose(controller.preview.smoothing, 0.1)


def test_the_tuned_baseline_differs_from_the_calibrated_one_in_its_settings_alone(bench) -> None:
    work = bench("gate")._replace(tuning=Tuning(4.0, -0.06))
    for ours, theirs in zip(make_controller("kalman", work), make_controller("kalman-tuned", work), strict=True):
        map_arrays(np.testing.assert_array_equal, ours, theirs)


def test_the_rule_serves_a_filter_where_sights_are_noisy(bench) -> None:
    assert isinstance(make_controller("parabola-lq", bench("box")).predictor, ParabolaAware)
    noisy = make_controller("parabola-lq", bench("box")._replace(noise=NOISE)).predictor
    assert isinstance(noisy, ParabolaFilter)
    assert noisy.noise.across_angle == pytest.approx(0.0017)
    assert noisy.speed.max() == pytest.approx(bench("box").conditions.max_lateral_speed)
    assert isinstance(make_controller("vertex", bench("box")._replace(noise=NOISE)).predictor, Vertex)


def test_an_unknown_controller_is_refused(bench) -> None:
    with pytest.raises(InputError, match=r"controller must be one of kalman, .*got 'guess'"):
        make_controller("guess", bench("box"))
