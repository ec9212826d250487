import pytest

from archerfish.cli.parsing import parse
from archerfish.cli.sweep import Sweep
from archerfish.cli.sweeping.sweep_file import read_sweep_file
from archerfish.records.errors import InputError

FILE = """
seeds = [0, 1]
trials = 8
command-limit = "box"
accept-unusable = true

[ppo]
steps = 5000
anneal = false

[vary]
"ppo.clip" = [0.1, 0.2]
ppo.actor-learning-rate = "3e-4..3e-3:log"
records = ["paper", "runs/infantry"]
"""


def test_a_file_says_what_the_command_line_says(tmp_path):
    path = tmp_path / "sweep.toml"
    path.write_text(FILE)
    vary = ["ppo.clip=0.1,0.2", "ppo.actor-learning-rate=3e-4..3e-3:log", "records=paper,runs/infantry"]
    words = ["--seeds", "0", "1", "--trials", "8", "--command-limit", "box", "--accept-unusable"]
    words += ["--ppo.steps", "5000", "--ppo.no-anneal", "--vary", *vary]
    assert read_sweep_file(path, Sweep) == parse(Sweep, "archerfish sweep", words)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("seed = ", "can't be read as TOML"),
        ("sedes = [0]", "--sedes"),
        ("trials = 'many'", "--trials"),
        ("[ppo]\nclip = -1", "--ppo.clip must be"),
    ],
)
def test_a_file_that_cant_be_used_is_refused_by_name(tmp_path, content, told):
    path = tmp_path / "sweep.toml"
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        read_sweep_file(path, Sweep)
    assert str(path) in str(caught.value)
    assert told in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml: no such file"):
        read_sweep_file(tmp_path / "none.toml", Sweep)
