import pytest

from archerfish.cli.interval_words import ends, with_digits, with_margin


@pytest.mark.parametrize(
    ("value", "interval", "scale", "words"),
    [
        (17.972, (17.86, 18.08), 1.0, "17.97±0.11"),
        (0.035, (0.0346, 0.0354), 1e3, "35.00±0.40"),
        (0.55, (0.48, 0.66), 1.0, "0.55 (0.48…0.66)"),
        (-0.0033, (-0.004, -0.0026), 1e3, "−3.3±0.7"),
        (0.019, None, 1.0, "0.019"),
    ],
)
def test_a_value_has_the_digits_that_its_interval_supports(value, interval, scale, words):
    assert with_margin(value, interval, scale) == words


def test_an_endless_interval_has_digits_all_the_same():
    assert ends((1.0, float("inf"))) == "1.000 … inf"
    assert with_digits(2.0, (0.0, float("inf"))) == "2.000"
