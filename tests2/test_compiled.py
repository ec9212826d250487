import os
import subprocess
import sys
from pathlib import Path

import pytest

from archerfish2 import compiled
from archerfish2.errors import InputError

SCRIPT = """
from archerfish2.compiled import import_jax
jax = import_jax()
print(jax.config.jax_compilation_cache_dir, jax.config.jax_compilation_cache_max_size)
"""


def folder_in_use(**variables: str) -> list[str]:
    plain = {name: value for name, value in os.environ.items() if not name.startswith(("JAX_", "ARCHERFISH_"))}
    done = subprocess.run([sys.executable, "-c", SCRIPT], env=plain | variables, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_programs_are_kept_in_the_folder_that_is_named_or_in_that_of_jax(tmp_path: Path) -> None:
    folder, size = folder_in_use(ARCHERFISH_CACHE=str(tmp_path / "kept"))
    assert Path(folder).is_dir()
    assert (Path(folder).parent, size) == (tmp_path / "kept" / "jax", "2000000000")
    given = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "own"), "ARCHERFISH_CACHE": str(tmp_path / "kept")}
    assert folder_in_use(**given) == [str(tmp_path / "own"), "-1"]


def test_the_cache_is_the_users_unless_it_is_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    assert compiled.cache_folder() is None
    monkeypatch.delenv("ARCHERFISH_CACHE")
    folder = compiled.cache_folder()
    assert folder is not None
    assert folder.parts[-3:-1] == ("archerfish", "jax")


def test_without_jax_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jax", None)
    assert not compiled.has_jax()
    with pytest.raises(InputError, match="pip install"):
        compiled.import_jax()
