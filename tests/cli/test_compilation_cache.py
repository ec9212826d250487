import os
import zlib
from pathlib import Path

import pytest

from archerfish.cli.compilation_cache import cache_folder, keep_compiled


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Folder that the environment names; nothing of JAX's settings is changed."""
    pytest.importorskip("jax")
    monkeypatch.setenv("ARCHERFISH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_the_variable_names_the_folder_or_switches_it_off(monkeypatch, tmp_path):
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setenv("ARCHERFISH_CACHE", str(tmp_path / "here"))
    assert tmp_path / "here" / "jax" in cache_folder().parents
    monkeypatch.setenv("ARCHERFISH_CACHE", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "users"))
    assert tmp_path / "users" / "archerfish" / "jax" in cache_folder().parents
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    assert cache_folder() is None
    assert keep_compiled() is None


def test_what_the_user_told_jax_is_left_alone(monkeypatch, asked):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "/elsewhere")
    assert keep_compiled() is None
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == "/elsewhere"
    assert not asked.exists()


def test_a_folder_that_can_t_be_made_is_done_without(monkeypatch):
    monkeypatch.setenv("ARCHERFISH_CACHE", "/proc/nowhere")
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    assert keep_compiled() is None


def test_a_program_that_was_written_by_half_is_removed(asked):
    from archerfish.cli.compilation_cache import _remove_truncated

    folder = cache_folder()
    folder.mkdir(parents=True)
    whole = zlib.compress(b"program" * 100)
    (folder / "whole-cache").write_bytes(whole)
    (folder / "half-cache").write_bytes(whole[: len(whole) // 2])
    (folder / "empty-cache").write_bytes(b"")
    _remove_truncated(folder)
    assert [path.name for path in folder.glob("*-cache")] == ["whole-cache"]
