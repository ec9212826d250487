"""Trials as plain Ray tasks, on this machine or on a cluster, with one processor each.

Results come back to the driver, which alone writes files, so the nodes share no disk. A task whose worker or node is
lost is run again by Ray, and once Ray gives up, handed in anew a few times; a result is taken once.
"""

import importlib.util
import os
import secrets
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from archerfish.cli.sweeping.executor import Executor
from archerfish.cli.workers import _SINGLE_THREAD
from archerfish.records.errors import InputError

LOOPBACK = "127.0.0.1"
RETRIES = 4
"""Times that Ray itself runs a task again whose worker or node is lost."""
RESUBMISSIONS = 2
"""Times that the driver then hands it in anew."""
OBJECT_STORE = 512 * 2**20
"""Shared memory of a local Ray [bytes]; a trial leaves about one megabyte."""
OWN_RAY = {
    "RAY_USAGE_STATS_ENABLED": "0",
    # Without this Ray turns 127.0.0.1 into an address that other machines reach, and listens on all of them.
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
    # A task without a graphics card sees none, which Ray otherwise announces as a coming change.
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "1",
}
"""Environment of a Ray that we start ourselves."""


def require_ray() -> None:
    """Refuse a sweep on Ray where it is not installed.

    Raises:
      InputError: saying what to install.
    """
    if importlib.util.find_spec("ray") is None:
        raise InputError(
            "archerfish sweep needs ray, which is not installed; pip install 'archerfish[sweep]', or pass --in-process"
        )


@contextmanager
def ray_executor(workers: int, address: str = "") -> Iterator[Executor]:
    """Start Ray on this machine, or join a cluster, while a block runs.

    Args:
      workers: trials side by side on this machine; a cluster decides for itself.
      address: HOST:PORT of a cluster's head, or "auto"; starts a local Ray if empty.

    Yields:
      What runs trials.

    Raises:
      InputError: if Ray can't be started or reached.
    """
    require_ray()
    # Set before Ray is imported: it reads some of them then.
    for name, value in ({} if address else own_ray()).items():
        os.environ.setdefault(name, value)
    import ray

    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR", "include_dashboard": None}
    own = {"num_cpus": workers, "include_dashboard": False, "_node_ip_address": LOOPBACK}
    own |= {"object_store_memory": OBJECT_STORE, "address": "local"}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            ray.init(**{**quiet, **({"address": address} if address else own)})
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        what = f"--address {address}: no Ray cluster answers" if address else "Ray does not start"
        raise InputError(f"{what} ({_first_line(error)}); start one with ray start, or pass --in-process") from error
    try:
        yield run_on_ray
    finally:
        ray.shutdown()


def own_ray() -> Mapping[str, str]:
    """Return the environment of a Ray that we start, with a token that keeps others on this machine out."""
    return {**OWN_RAY, "RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}


def run_on_ray(work: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[int, Any]]:
    """Run jobs as tasks of the Ray that this process has joined, each on one processor with one thread.

    Raises:
      InputError: if a job loses its worker again and again; whatever a job raises.
    """
    import ray

    task = ray.remote(num_cpus=1, max_retries=RETRIES, runtime_env={"env_vars": _SINGLE_THREAD})(_perform)
    pending = {task.remote(work, job): index for index, job in enumerate(jobs)}
    lost: Counter[int] = Counter()
    try:
        while pending:
            (done,), _ = ray.wait(list(pending), num_returns=1)
            index = pending.pop(done)
            try:
                result = ray.get(done)
            except _lost() as error:
                lost[index] += 1
                if lost[index] > RESUBMISSIONS:
                    raise InputError(_given_up(index, error)) from error
                pending[task.remote(work, jobs[index])] = index
                continue
            yield index, result
    finally:
        for each in pending:
            ray.cancel(each, force=True)


def _perform(work: Callable[[Any], Any], job: Any) -> Any:
    return work(job)


def _lost() -> tuple[type[Exception], ...]:
    """Return what Ray raises where a worker, its node or its result is gone."""
    from ray import exceptions

    return (
        exceptions.WorkerCrashedError,
        exceptions.NodeDiedError,
        exceptions.ObjectLostError,
        exceptions.OutOfMemoryError,
        exceptions.LocalRayletDiedError,
    )


def _given_up(index: int, error: Exception) -> str:
    return (
        f"job {index} of this round lost its worker {RESUBMISSIONS + 1} times in spite of retries, most likely for "
        f"want of memory ({_first_line(error)}); use fewer --workers, then go on with --resume"
    )


def _first_line(error: Exception) -> str:
    return next((line for line in str(error).splitlines() if line.strip()), type(error).__name__)
