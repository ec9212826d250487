import pytest

pytest.importorskip("jax")

from archerfish.cli.sweeping.axes import Range, Values, corners, grid, parse_vary
from archerfish.cli.sweeping.parameters import PARAMETERS
from archerfish.records.errors import InputError


def test_values_have_the_type_of_their_parameter():
    axes = parse_vary(["ppo.clip=0.1,1", "ppo.hidden=32,64", "ppo.anneal=true,False", "target=paper,static"])
    assert axes == (
        Values("ppo.clip", (0.1, 1.0)),
        Values("ppo.hidden", (32, 64)),
        Values("ppo.anneal", (True, False)),
        Values("target", ("paper", "static")),
    )
    assert [type(value) for value in axes[0].values] == [float, float]


def test_a_range_is_linear_or_logarithmic_whole_or_not():
    assert parse_vary(["ppo.actor_learning_rate=3e-4..3e-3:log", "ppo.epochs=2..8"]) == (
        Range("ppo.actor-learning-rate", 3e-4, 3e-3, True, False),
        Range("ppo.epochs", 2, 8, False, True),
    )


def test_a_grid_has_every_combination_once_the_last_changing_fastest():
    axes = parse_vary(["ppo.clip=0.1,0.2", "target=paper,static,dynamic"])
    found = [tuple(each.values()) for each in grid(axes)]
    assert found == [(clip, target) for clip in (0.1, 0.2) for target in ("paper", "static", "dynamic")]
    assert grid([]) == [{}]


def test_corners_hold_every_value_and_both_ends():
    axes = parse_vary(["ppo.clip=0.1..0.3", "target=paper,static,dynamic"])
    found = corners(axes)
    assert {each["ppo.clip"] for each in found} == {0.1, 0.3}
    assert {each["target"] for each in found} == {"paper", "static", "dynamic"}


def test_a_misspelt_parameter_is_named_with_all_that_there_are():
    with pytest.raises(InputError) as caught:
        parse_vary(["ppo.cilp=0.1"])
    assert "no parameter 'ppo.cilp'" in str(caught.value)
    assert "perhaps you meant ppo.clip" in str(caught.value)
    assert all(name in str(caught.value) for name in PARAMETERS)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["ppo.clip"], "expected NAME=VALUES"),
        (["ppo.clip="], "ppo.clip: expected a finite number, got ''"),
        (["ppo.clip=0.1,nan"], "expected a finite number, got 'nan'"),
        (["ppo.hidden=3.5"], "expected a whole number, got '3.5'"),
        (["ppo.anneal=maybe"], "expected true or false"),
        (["target=flying"], "expected one of paper, static, dynamic"),
        (["ppo.clip=0.1,0.10"], "a value is given twice"),
        (["ppo.clip=0.1", "ppo.clip=0.2"], "gives ppo.clip twice"),
        (["ppo.clip=0.3..0.1"], "lower end must lie below"),
        (["ppo.clip=0..0.1:log"], "must begin above 0"),
        (["ppo.clip=0.1..0.2:lin"], "expected LOW..HIGH or LOW..HIGH:log"),
        (["motion.max-lateral-speed=0.1..0.2"], "a sampler would pick the easiest"),
        (["motion.parabola-curvature=0"], "expected a number > 0"),
        (["seed=0,1"], "--seeds 0 1 2"),
    ],
)
def test_what_cant_be_varied_is_refused(words, told):
    with pytest.raises(InputError, match="--vary") as caught:
        parse_vary(words)
    assert told in str(caught.value)
