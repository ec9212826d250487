"""Jobs of a sweep as tasks of Ray, on this machine or on a cluster, with one processor each.

Nodes share no disk: a task works in a folder of its own and returns its files, which the sweep writes. A task whose
worker or node is lost is run again by Ray.
"""

import contextlib
import logging
import os
import secrets
import signal
import socket
import tempfile
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from archerfish.errors import InputError, one_line
from archerfish.reports import progress
from archerfish.storage import LOCK, write_bytes
from archerfish.studies.sweep_trial import HITS
from archerfish.studies.workers import ONE_THREAD, Job

RETRIES = 4
"""Times that a task is run again whose worker or node is lost."""
ANSWER_S = 10.0
"""That a cluster has to answer [s]."""
_OWN = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_worker_niceness": "0",  # as that of processes without Ray
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # else Ray listens on all addresses of the machine
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "1",  # a task without a graphics card sees none; else Ray warns of it
    "RAY_AUTH_MODE": "token",  # else whoever is on this machine may run programs in it
}


def run_on_ray(jobs: Sequence[Job], workers: int, address: str) -> None:
    """Run trainings, and write the files of their folders as they finish, `HITS` last.

    Args:
      jobs: with the argument "folder".
      workers: that run at once on this machine.
      address: "local", or HOST:PORT of a cluster.

    Raises:
      InputError: if Ray can't be started or joined, or a job loses its worker again and again; what a job raises.
    """
    is_own = address == "local"
    for name, value in ({**_OWN, "RAY_AUTH_TOKEN": secrets.token_hex(32)} if is_own else {}).items():
        os.environ.setdefault(name, value)  # before Ray is imported, which reads some of it then
    import ray

    own: dict[str, Any] = {"num_cpus": workers, "include_dashboard": False, "_node_ip_address": "127.0.0.1"}
    before = signal.getsignal(signal.SIGTERM)
    try:
        if not is_own:  # of an address where nothing answers Ray would wait for many minutes
            host, _, port = address.rpartition(":")
            socket.create_connection((host, int(port)), ANSWER_S).close()
        with warnings.catch_warnings(action="ignore"):
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR, **(own if is_own else {}))
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        raise _fault(address, error, "start a cluster with ray start") from error
    try:
        with contextlib.suppress(ValueError):  # in another thread than the main one Ray has set none
            signal.signal(signal.SIGTERM, before)  # Ray's own ends the process at once
        task = ray.remote(num_cpus=1, max_retries=RETRIES, runtime_env={"env_vars": ONE_THREAD})(_files)
        pending = {task.remote(job.function, job.arguments): job for job in jobs}
        with progress.bar("sweep", len(jobs), "trainings") as advance:
            while pending:
                (done,), _ = ray.wait(list(pending), num_returns=1)
                job = pending.pop(done)
                for name, content in ray.get(done).items():
                    write_bytes(job.arguments["folder"] / name, content)
                advance(len(jobs) - len(pending), job.name)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from error
    except ray.exceptions.RayError as error:
        raise _fault(address, error, "use fewer workers, if memory is short") from error
    finally:
        ray.shutdown()


def _fault(address: str, error: Exception, remedy: str) -> InputError:
    text = one_line(str(error).strip().partition("\n")[0])[:200]
    return InputError(f"ray {address}: {text}; {remedy}, or leave --ray out")


def _files(function: Callable[..., None], arguments: dict[str, Any]) -> dict[str, bytes]:
    """Run a job in a folder of this machine and return the files that it wrote there."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made) / arguments["folder"].name
        function(**{**arguments, "folder": folder})
        files = {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.name not in (LOCK, HITS)}
        return {**files, HITS: (folder / HITS).read_bytes()}
