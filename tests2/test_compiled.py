import sys
from pathlib import Path

from archerfish2 import compiled

CODE = "from archerfish2.compiled import import_jax\nprint(import_jax().config.jax_compilation_cache_dir)"


def test_programs_are_kept_in_the_folder_that_is_named_or_in_that_of_jax(run_python, tmp_path):
    names = {"ARCHERFISH_CACHE": str(tmp_path), "JAX_COMPILATION_CACHE_DIR": ""}
    assert Path(run_python(CODE, **names).strip()).relative_to(tmp_path).parts[0] == "jax"
    assert run_python(CODE, **names | {"JAX_COMPILATION_CACHE_DIR": "/own"}) == "/own\n"


def test_the_cache_is_the_users_unless_it_is_off_and_without_jax_the_error_says_what_to_install(monkeypatch, refused):
    monkeypatch.delenv("ARCHERFISH_CACHE", raising=False)
    assert compiled.cache_folder("jax").parts[-2:] == ("archerfish", "jax")
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    assert compiled.cache_folder("jax") is None
    monkeypatch.setitem(sys.modules, "jax", None)
    refused("pip install", compiled.import_jax)
