import numpy as np
import pytest

from archerfish.identification.doctor.checks import check_recordings
from archerfish.identification.doctor.signals import signal_findings
from archerfish.records.errors import InputError
from archerfish.records.recording import make_recording

RNG = np.random.default_rng(0)


def recording(count=400, period=0.01, inputs=1, outputs=1, source="log.csv"):
    return make_recording(
        RNG.standard_normal((count, inputs)),
        RNG.standard_normal((count, outputs)),
        period,
        input_names=[f"u{index}" for index in range(inputs)],
        output_names=[f"y{index}" for index in range(outputs)],
        source=source,
    )


def still(which):
    u, y = RNG.standard_normal((2, 400))
    return make_recording(np.full(400, 2.0) if which == "u" else u, np.zeros(400) if which == "y" else y, 0.01)


def twins():
    """The third input is the difference of the others."""
    u, v, y = RNG.standard_normal((3, 400))
    return make_recording(np.stack([u, v, v - u + 3], axis=1), y, 0.01, input_names=("u", "v", "w"))


@pytest.mark.parametrize(
    ("recordings", "order", "message"),
    [
        ([], 4, "needs at least one recording"),
        ([recording()], 0, "order must be from 1 to 8, got 0"),
        ([recording(count=100)], 4, "100 samples are too few for order 4, which needs 140"),
        ([recording(), recording(count=20, source="b.csv")], 4, r"b\.csv: 20 samples are too few for order 4"),
        ([recording(inputs=2, outputs=3)], 4, "one input or one output, got 2 inputs and 3 outputs"),
        ([recording(), recording(outputs=2, source="b.csv")], 4, r"b\.csv: has 2 outputs, log\.csv has 1"),
        ([twins()], 4, "of the inputs u, v, w one is a copy or a mixture"),
        ([recording(), recording(inputs=2, source="b.csv")], 4, r"b\.csv: has 2 inputs, log\.csv has 1"),
        ([recording(), recording(period=0.02, source="b.csv")], 4, r"b\.csv: is sampled every 0\.02 s"),
        ([still("u")], 4, 'input "u" is 2 throughout'),
        ([still("y")], 4, 'output "y" is 0 throughout'),
    ],
)
def test_recordings_that_can_not_bear_the_estimate_are_refused(recordings, order, message):
    with pytest.raises(InputError, match=message):
        check_recordings(recordings, order)


def test_sound_recordings_pass_without_remark():
    assert check_recordings([recording(), recording()], 4) == []


def test_one_input_may_have_several_outputs():
    assert check_recordings([recording(outputs=3), recording(outputs=3)], 4) == []


def test_inputs_that_are_alike_in_one_log_and_not_in_another_are_told_apart():
    u, y = RNG.standard_normal((2, 400))
    alike = make_recording(np.stack([u, u], axis=1), y, 0.01, input_names=("u0", "u1"))
    assert check_recordings([alike, recording(inputs=2)], 4) == []


def test_a_signal_that_is_cut_off_is_remarked_and_a_step_is_not():
    signal = RNG.standard_normal(400)
    cut = make_recording(np.clip(signal, -1, 1), signal, 0.01, source="cut.csv")
    steps = make_recording(np.repeat([0.0, 1.0], 200), signal, 0.01)
    remarks = check_recordings([cut, steps], 4)
    assert len(remarks) == 1
    assert 'cut.csv: "u" sits at its extreme' in remarks[0]


def stepped(frozen):
    """Steps to levels held for 2 s, and an angle that comes to rest at each, on a grid like an encoder's."""
    u = np.repeat([0.0, 0.3, -0.2, 0.4, 0.0], 200)
    aims = np.concatenate([np.zeros(2), u[:-2]])
    y = np.zeros(len(u))
    for index in range(1, len(u)):
        y[index] = y[index - 1] + 0.2 * (aims[index] - y[index - 1])
    y = np.round(y, 3)
    if frozen:
        y[350:650] = y[350]
    return make_recording(u, y, 0.01)


@pytest.mark.parametrize(("frozen", "told"), [(False, []), (True, ["frozen"])])
def test_an_output_at_rest_while_a_level_is_held_is_not_frozen_and_one_that_misses_a_step_is(frozen, told):
    assert [each.code for each in signal_findings(stepped(frozen)) if each.code == "frozen"] == told
