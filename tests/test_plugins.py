"""What a file says of code is compared and shown, never followed."""

from pathlib import Path

import pytest

from archerfish.plugins import code_file_name, names_code, not_run, same_code_name


@pytest.mark.parametrize("spec", ["./mine.py:Mine", "mine:Mine", "folder/notes.txt:Mine", "mine.py:a/b", ":Mine"])
def test_code_in_a_file_or_module_is_not_an_entry_point(spec: str) -> None:
    assert names_code(spec)
    assert not names_code("departure")


def test_code_of_one_name_is_the_same_wherever_its_file_lies() -> None:
    assert same_code_name("./mine.py:Mine", "/elsewhere/mine.py:Mine")
    assert not same_code_name("./mine.py:Mine", "./mine.py:Other")
    assert not same_code_name("Mine", "Mine")


@pytest.mark.parametrize(
    ("spec", "name"),
    [("./mine.py:Mine", "mine.py"), ("mine:Mine", "mine.py"), ("package.mine:Mine", "mine.py"), ("a/b.txt:f", "b.txt")],
)
def test_the_file_of_code_is_named_as_provenance_names_it(spec: str, name: str) -> None:
    assert code_file_name(spec) == name


def test_the_error_has_the_hash_and_what_to_type_as_the_shell_takes_it() -> None:
    spec = "a b.py:f; rm -rf ~"
    message = str(not_run(Path("config.json"), {"--pitch": spec, "--yaw": "yaw.json"}, {"a b.py": "1a2b"}))
    assert message.startswith(
        f"config.json: names code, {spec} (SHA-256 1a2b), and code that only a file names is not run"
    )
    assert message.endswith("then add --pitch 'a b.py:f; rm -rf ~' --yaw yaw.json")
