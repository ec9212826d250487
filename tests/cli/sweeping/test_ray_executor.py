"""The executor against a made-up Ray, and where there is one, against a cluster of which one node is killed."""

import importlib.util
import subprocess
import sys
import types

import pytest

from archerfish.cli.sweeping import ray_executor
from archerfish.records.errors import InputError


class LostError(Exception):
    pass


class MadeUpRay:
    """Runs a task when it is waited for; some calls lose their worker."""

    def __init__(self, losses):
        self.losses, self.calls, self.cancelled = dict(losses), [], []
        self.exceptions = types.SimpleNamespace(
            **dict.fromkeys(
                ("WorkerCrashedError", "NodeDiedError", "ObjectLostError", "OutOfMemoryError", "LocalRayletDiedError"),
                LostError,
            )
        )

    def remote(self, **options):
        assert options["num_cpus"] == 1
        assert options["max_retries"] >= 1
        assert options["runtime_env"]["env_vars"]["OMP_NUM_THREADS"] == "1"

        def decorate(function):
            def call(*arguments):
                self.calls.append(arguments[1:])
                return (len(self.calls), function, arguments)

            return types.SimpleNamespace(remote=call)

        return decorate

    def wait(self, pending, num_returns):
        assert num_returns == 1
        return pending[-1:], pending[:-1]  # the last one finishes first

    def get(self, pending):
        _, function, arguments = pending
        if self.losses.get(arguments[1], 0):
            self.losses[arguments[1]] -= 1
            raise LostError("the node is gone")
        return function(*arguments)

    def cancel(self, pending, force):
        self.cancelled.append(pending[2][1])


@pytest.fixture
def made_up_ray(monkeypatch):
    def make(losses):
        ray = MadeUpRay(losses)
        monkeypatch.setitem(sys.modules, "ray", ray)
        return ray

    return make


def squared(number):
    return number**2


def test_every_job_is_yielded_once_under_its_number(made_up_ray):
    made_up_ray({})
    assert list(ray_executor.run_on_ray(squared, [3, 1, 2])) == [(2, 4), (1, 1), (0, 9)]


def test_a_lost_job_is_handed_in_anew(made_up_ray):
    ray = made_up_ray({1: 1, 3: ray_executor.RESUBMISSIONS})
    assert sorted(ray_executor.run_on_ray(squared, [3, 1, 2])) == [(0, 9), (1, 1), (2, 4)]
    assert len(ray.calls) == 3 + 1 + ray_executor.RESUBMISSIONS


def test_a_job_that_is_lost_again_and_again_ends_the_sweep_and_the_others(made_up_ray):
    ray = made_up_ray({2: 99})
    with pytest.raises(InputError, match=r"lost its worker 3 times.*\(the node is gone\).*--resume"):
        list(ray_executor.run_on_ray(squared, [3, 1, 2]))
    assert sorted(ray.cancelled) == [1, 3]


def test_a_fault_of_a_job_is_raised_as_it_is(made_up_ray):
    made_up_ray({})
    with pytest.raises(TypeError):
        list(ray_executor.run_on_ray(squared, ["x"]))


def test_a_machine_without_ray_is_told_what_to_install(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs ray, which is not installed; pip install 'archerfish\[sweep\]'"):
        ray_executor.require_ray()


# In a process of its own: Ray reads its environment once, and its warnings are not ours.
TWO_NODES = """
import os, signal, socket, threading, time
from archerfish.cli.sweeping.ray_executor import own_ray, ray_executor
os.environ.update(own_ray())
from ray.cluster_utils import Cluster

cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
lost = cluster.add_node(num_cpus=1)
home, lost_id = os.environ["RECORDS"], lost.node_id

def work(job):
    import os, pathlib, time, ray
    node = ray.get_runtime_context().get_node_id()
    (pathlib.Path(os.environ["RECORDS"]) / f"{node}-{os.getpid()}-{job}-{time.time_ns()}").touch()
    # What is begun on the second node ends with it alone.
    time.sleep(60.0 if node == lost_id else 0.1)
    return job**2, os.environ["OMP_NUM_THREADS"]

def kill():
    # Once the second node is at work; without its raylet, a worker would still end what it has begun.
    while not any(lost.node_id in name for name in os.listdir(home)):
        time.sleep(0.05)
    workers = {int(name.split("-")[1]) for name in os.listdir(home) if lost.node_id in name}
    for process in [lost.all_processes["raylet"][0].process.pid, *workers]:
        os.kill(process, signal.SIGKILL)

threading.Thread(target=kill, daemon=True).start()
with ray_executor(0, cluster.address) as executor:
    print("RESULTS", sorted(executor(work, list(range(8)))))
cluster.shutdown()
begun = os.listdir(home)
print("BEGUN", len(begun), any(lost.node_id in name for name in begun))
"""


@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="needs ray, of the extra sweep")
def test_a_killed_node_loses_no_job_and_doubles_none(tmp_path, monkeypatch):
    monkeypatch.setenv("RECORDS", str(tmp_path))
    done = subprocess.run([sys.executable, "-c", TWO_NODES], capture_output=True, text=True, timeout=180, check=False)
    told = dict(line.split(" ", 1) for line in done.stdout.splitlines() if line.startswith(("RESULTS", "BEGUN")))
    assert done.returncode == 0, done.stderr
    assert told["RESULTS"] == str([(index, (index**2, "1")) for index in range(8)])
    begun, on_the_lost_one = told["BEGUN"].split()
    assert on_the_lost_one == "True"
    assert int(begun) > 8


# What listens is looked up where Linux tells; addresses of a local Ray must all be loopback's.
LISTENING = """
import os, pathlib, subprocess, time
from archerfish.cli.sweeping.ray_executor import ray_executor

def sockets():
    found = set()
    for version in ("tcp", "tcp6"):
        for line in pathlib.Path("/proc/net", version).read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A":
                found.add((fields[1].split(":")[0], fields[9]))
    return found

before = {inode for _, inode in sockets()}
with ray_executor(1) as executor:
    print("RESULT", list(executor(abs, [-3])))
    print("OPEN", sorted({address for address, inode in sockets() if inode not in before}))
"""
LOOPBACK = {"0100007F", "0000000000000000FFFF00000100007F", "00000000000000000000000001000000"}


@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="needs ray, of the extra sweep")
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_a_local_ray_listens_on_loopback_alone():
    done = subprocess.run([sys.executable, "-c", LISTENING], capture_output=True, text=True, timeout=180, check=False)
    assert "RESULT [(0, 3)]" in done.stdout, done.stderr
    (opened,) = (line for line in done.stdout.splitlines() if line.startswith("OPEN"))
    found = set(opened.removeprefix("OPEN ").strip("[]").replace("'", "").split(", "))
    assert found
    assert found <= LOOPBACK
