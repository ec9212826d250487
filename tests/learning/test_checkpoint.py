from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from archerfish.learning.checkpoint import read_checkpoint, write_checkpoint
from archerfish.learning.config import PpoConfig
from archerfish.learning.ppo import Learner, iterate, make_learner, sizes
from archerfish.learning.training import CHUNK, weights_hash
from archerfish.learning.update import hyper
from archerfish.records.errors import InputError
from archerfish.simulation.environment import ShootingEnvironment


@pytest.fixture(scope="module")
def learner(shooting: ShootingEnvironment, tiny: PpoConfig) -> Learner:
    """Half-way through a training."""
    return go_on(shooting, tiny, make_learner(shooting, tiny, jax.random.key(5)))


def go_on(environment: ShootingEnvironment, config: PpoConfig, learner: Learner) -> Learner:
    return iterate(environment, hyper(config), learner, sizes(config), CHUNK)[0]


def leaves(learner: Learner) -> list[Any]:
    return [np.asarray(each) for each in jax.tree.leaves(learner._replace(key=jax.random.key_data(learner.key)))]


def test_a_learner_is_read_back_bit_for_bit(
    tmp_path: Path, shooting: ShootingEnvironment, tiny: PpoConfig, learner: Learner
) -> None:
    write_checkpoint(tmp_path / "checkpoint.json", learner, {"note": "half-way"})
    restored, facts = read_checkpoint(tmp_path / "checkpoint.json", make_learner(shooting, tiny, jax.random.key(9)))
    for written, read in zip(leaves(learner), leaves(restored), strict=True):
        assert written.dtype == read.dtype
        np.testing.assert_array_equal(written, read)
    assert facts["note"] == "half-way"
    # Going on from the file is going on from memory.
    assert weights_hash(go_on(shooting, tiny, restored)) == weights_hash(go_on(shooting, tiny, learner))


def test_a_checkpoint_of_another_configuration_is_refused(tmp_path: Path, learner: Learner) -> None:
    write_checkpoint(tmp_path / "checkpoint.json", learner, {})
    of_fewer_environments = learner._replace(observation=learner.observation[:4])
    with pytest.raises(InputError, match=r"checkpoint\.json: array .* go on with the configuration"):
        read_checkpoint(tmp_path / "checkpoint.json", of_fewer_environments)


def test_another_kind_of_record_is_refused(tmp_path: Path, learner: Learner) -> None:
    path = tmp_path / "checkpoint.json"
    write_checkpoint(path, learner, {})
    path.write_text(path.read_text().replace("archerfish.checkpoint/1", "archerfish.policy/1"))
    with pytest.raises(InputError, match=r"archerfish\.policy/1"):
        read_checkpoint(path, learner)
