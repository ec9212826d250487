"""What is said of a word or a field of a file that there is not, by the lines of deploy.toml."""

import pytest

from archerfish.runtime.configuration import read_config


@pytest.mark.parametrize(
    "text, pattern",
    [
        ('yaw_reference = "gyro"', "field yaw_reference: .*'gyro', expected one of encoder, fixed-chassis; correct it"),
        ('yaw_reference = "encodr"', "expected one of encoder, fixed-chassis; perhaps you meant encoder; correct it"),
        ("baud = 9600", "field baud: .*9600, expected one of 115200, .*, 2000000; correct it"),
        ('yaw_ref = "encoder"', "toml: .*unknown field yaw_ref; perhaps you meant yaw_reference; correct it"),
        ("[detections]\nlatency = 3", "field detections: .*unknown field latency; perhaps you meant latency_ms"),
        ("[gate]\nyaw = { max_rat = 3 }", r"field gate\.yaw: .*unknown field max_rat; perhaps you meant max_rate"),
        (
            '[detections]\nyaw_reference = "encoder"',
            r"field detections: .*yaw_reference, which belongs to the top level \(in TOML, above the tables\); correct",
        ),
        ("watchdog = 3", "unknown field watchdog; correct it"),
    ],
)
def test_a_word_or_a_field_that_there_is_not_is_refused_with_those_that_there_are(text, pattern, tmp_path, refused):
    (tmp_path / "deploy.toml").write_text(text)
    refused(pattern, read_config, tmp_path)
