from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of recorded logs and references, which lies beside the repository and is not part of it."""
    folder = Path(__file__).parents[3] / "shared"
    if not folder.is_dir():
        pytest.skip("needs the folder ../shared, beside the repository")
    return folder


@pytest.fixture(scope="session")
def reference(shared: Path) -> Path:
    """Folder of the first edition's records, logs and policies."""
    return shared / "second_edition" / "reference"
