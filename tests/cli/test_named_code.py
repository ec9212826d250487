"""Code that a received folder or file names is not run; code that the command line names is."""

import hashlib
import importlib.util
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from archerfish.cli import view
from archerfish.cli.setting import SettingFiles, load_setting, trained_for
from archerfish.cli.train import Train
from archerfish.cli.view import View
from archerfish.records.errors import InputError

Command = Callable[..., tuple[int, str, str]]
Refused = Callable[..., str]
needs_viser = pytest.mark.skipif(importlib.util.find_spec("viser") is None, reason="needs viser, the extra view")
needs_jax = pytest.mark.skipif(importlib.util.find_spec("jax") is None, reason="needs JAX, the extra train")

CODE = """
from pathlib import Path
from typing import Any, NamedTuple
from archerfish.paper.gimbal import printed_plants

Path({marker!r}).write_text("run")

def gimbal(axis): return printed_plants()[axis]

class Still(NamedTuple):
    place: Any
    @classmethod
    def draw(cls, place, speed, chance): return cls(place)
    def position(self, time): return self.place + 0.0 * time[..., None]

class Other(Still): pass
"""


@pytest.fixture
def marker(tmp_path: Path) -> Path:
    """Is there once the code in the received folder was run."""
    return tmp_path / "marker"


@pytest.fixture
def received(tmp_path: Path, marker: Path) -> Path:
    """A folder from somebody else, with code under names that look harmless."""
    folder = tmp_path / "received"
    folder.mkdir()
    for name in ("notes.txt", "notes.py"):
        (folder / name).write_text(CODE.format(marker=str(marker)))
    return folder


def unfinished(folder: Path, **facts: Any) -> Path:
    """Make a folder look like one of an unfinished training."""
    path = folder / "unfinished" / "config.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(facts))
    return path


@needs_viser
@pytest.mark.parametrize(
    ("named", "to_type"),
    [
        ({"plant": "received/notes.txt:gimbal"}, "--plant received/notes.txt:gimbal"),
        ({"plant": "received.notes:gimbal"}, "--plant received.notes:gimbal"),
        (
            {"pitch": "received/notes.txt:gimbal", "yaw": "yaw.json"},
            "--pitch received/notes.txt:gimbal --yaw yaw.json",
        ),
    ],
)
def test_a_run_folder_that_is_viewed_runs_no_code(
    refused: Refused, records: Path, received: Path, marker: Path, named: dict[str, str], to_type: str
) -> None:
    for name in ("policy.json", "policy.safetensors"):
        shutil.copy(records / name, received)
    digest = hashlib.sha256((received / "notes.txt").read_bytes()).hexdigest()
    inputs = {"notes.txt": digest, "notes.py": digest}
    facts = {"setting": {**named, "robot": "theirs"}, "provenance": {"inputs": inputs}}
    (received / "config.json").write_text(json.dumps(facts))
    message = refused("view", "received", "--export", "film.html")
    spec = next(iter(named.values()))
    assert f"received/config.json: names code, {spec} (SHA-256 {digest})" in message
    assert message.endswith(f"then add {to_type}\n")
    assert not marker.exists()

    typed = SettingFiles(plant=spec)
    assert view._subject(View(setting=typed), received / "policy.json").name == "identified-theirs"
    assert marker.exists()


def test_a_plant_that_is_typed_or_installed_is_run_whatever_a_run_folder_names(
    received: Path, marker: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy, site = received / "policy.json", tmp_path / "site" / "their_gimbal-1.0.dist-info"
    site.mkdir(parents=True)
    (site / "METADATA").write_text("Metadata-Version: 2.1\nName: their_gimbal\nVersion: 1.0\n")
    (site / "entry_points.txt").write_text("[archerfish.plants]\nprinted = archerfish.paper.gimbal:printed_plants\n")
    monkeypatch.syspath_prepend(str(site.parent))
    (received / "config.json").write_text(json.dumps({"setting": {"plant": "printed", "robot": "theirs"}}))
    assert trained_for(policy, SettingFiles()) == SettingFiles(plant="printed", robot="theirs")

    (received / "config.json").write_text(json.dumps({"setting": {"plant": "gone.py:gimbal", "robot": "theirs"}}))
    typed = SettingFiles(plant=f"{received}/notes.txt:gimbal")
    files = trained_for(policy, typed)
    assert files == replace(typed, robot="theirs")
    assert not marker.exists()
    assert load_setting(files).name == "identified-theirs"
    assert marker.exists()


@pytest.mark.parametrize("setting", [{"plant": ["received/notes.txt:gimbal"]}, {"pitch": 5, "yaw": 5}])
def test_a_setting_of_another_type_is_refused_with_its_file(received: Path, setting: dict[str, Any]) -> None:
    (received / "config.json").write_text(json.dumps({"setting": setting}))
    with pytest.raises(InputError, match=r'config\.json: "(plant|pitch)" is .*, expected a text'):
        trained_for(received / "policy.json")


@pytest.mark.parametrize("setting", [["x"], 5, True])
def test_a_setting_that_is_none_is_not_taken_for_the_paper_s(received: Path, setting: Any) -> None:
    (received / "config.json").write_text(json.dumps({"setting": setting}))
    with pytest.raises(InputError, match=r'config\.json: "setting" is .*, expected an object'):
        trained_for(received / "policy.json")


@needs_jax
@pytest.mark.parametrize("digest", [None, "1a2b"])
def test_a_training_that_goes_on_runs_no_code_that_its_folder_alone_names(
    refused: Refused, received: Path, marker: Path, digest: str | None
) -> None:
    unfinished(received, motion="received/notes.txt:Still", **({"motion_sha256": digest} if digest else {}))
    message = refused("train", "--resume", "received")
    hashed = " (SHA-256 1a2b)" if digest else ""
    assert f"received/unfinished/config.json: names code, received/notes.txt:Still{hashed}, and" in message
    assert message.endswith("then add --motion received/notes.txt:Still\n")
    assert not marker.exists()


@needs_jax
@pytest.mark.parametrize("linked", [False, True], ids=["no copies", "a link with the name of code"])
def test_a_training_that_goes_on_reads_its_copies_and_runs_no_plant(
    refused: Refused, received: Path, marker: Path, linked: bool
) -> None:
    spec = "received/notes.txt:gimbal"
    unfinished(received, setting={"pitch": spec, "yaw": spec, "robot": "theirs"})
    for axis in ("pitch", "yaw") if linked else ():
        copies = received / "unfinished" / "inputs" / axis
        copies.mkdir(parents=True)
        shutil.copy(received / "notes.txt", copies / "notes.safetensors")
        (copies / "notes.safetensors:gimbal").symlink_to("nothing")
    assert "inputs/pitch: holds no copy of the pitch record" in refused("train", "--resume", "received")
    assert not marker.exists()


@needs_jax
def test_a_motion_without_a_hash_in_the_record_is_refused_even_if_it_is_typed(
    refused: Refused, received: Path, tmp_path: Path
) -> None:
    shutil.copy(received / "notes.py", tmp_path / "mine.py")
    (tmp_path / "marker").write_text("run")
    unfinished(received, motion="./mine.py:Still")
    message = refused("train", "--resume", "received", "--motion", "./mine.py:Still")
    assert "mine.py: can't be compared: received holds no hash of the motion that it was begun with" in message


def test_a_motion_is_named_again_wherever_its_file_lies_but_by_its_own_name(received: Path) -> None:
    unfinished(received, motion="./mine.py:Still", motion_sha256="1a2b")

    def typed(motion: str) -> Train:
        return Train(resume=received).resumed(lambda default: replace(default, motion=motion))

    assert typed("elsewhere/mine.py:Still").motion == "elsewhere/mine.py:Still"
    with pytest.raises(InputError, match=r"--motion \./mine\.py:Other contradicts .* begun with \./mine\.py:Still"):
        typed("./mine.py:Other")


def test_a_folder_does_not_say_where_a_training_that_goes_on_writes(received: Path, tmp_path: Path) -> None:
    unfinished(received, json=str(tmp_path / "theirs.json"), out=str(tmp_path / "theirs"))
    resumed = Train(resume=received).resumed(lambda default: default)
    assert (resumed.json, resumed.out) == (None, received)


@needs_jax
@pytest.mark.parametrize("options", [("plant",), ("pitch", "yaw")])
def test_a_sweep_file_runs_no_code(refused: Refused, received: Path, marker: Path, options: tuple[str, ...]) -> None:
    spec = "received/notes.txt:gimbal"
    lines = [*(f'{option} = "{spec}"' for option in options), 'robot = "theirs"']
    (received / "sweep.toml").write_text("\n".join(lines))
    message = refused("sweep", "received/sweep.toml", "--in-process")
    assert f"received/sweep.toml: names code, {spec}, and" in message
    assert message.endswith(f"then add {' '.join(f'--{option} {spec}' for option in options)}\n")
    assert not marker.exists()


@needs_jax
@pytest.mark.parametrize("said", ['plant = "./mine.py:gimbal"\n', ""])
def test_code_that_is_typed_beside_a_sweep_file_is_run(received: Path, marker: Path, said: str) -> None:
    from archerfish.cli.sweep import Sweep
    from archerfish.cli.sweeping.preparation import prepare

    path = received / "sweep.toml"
    path.write_text(f'{said}robot = "mine"\n')

    def prepared(name: str) -> Any:
        typed = SettingFiles(plant=f"{received}/notes.txt:{name}")
        return prepare(Sweep(file=path, in_process=True, setting=typed))

    assert prepared("gimbal").plan.base.setting.name == "identified-mine"
    assert marker.exists()
    if said:
        with pytest.raises(InputError, match="--plant stands beside"):
            prepared("other")


@needs_jax
def test_a_sweep_file_has_the_parser_write_no_file(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "sweep.toml").write_text('tyro_write-completion = ["bash", "theirs.sh"]\n')
    assert "--tyro_write-completion is no option of a sweep" in refused("sweep", "sweep.toml", "--in-process")
    assert not (tmp_path / "theirs.sh").exists()
