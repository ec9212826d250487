from pathlib import Path

import pytest

try:
    import jax
except ImportError:  # the robot's installation has no JAX; the tests that need it import it themselves
    pass
else:
    # A silent broadcast of shape (3,) against (2, 3) is how batch dimensions get mixed up.
    jax.config.update("jax_numpy_rank_promotion", "raise")

SHARED_DATA = Path(__file__).parents[1] / ".." / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of recorded logs, which lies beside the repository and is not part of it."""
    if not SHARED_DATA.is_dir():
        pytest.skip("needs the recorded logs in ../shared/data, beside the repository")
    return SHARED_DATA.resolve()
