"""Where the time of a training goes, from the start of its process to its end, in seconds.

`python benchmarks/training_stages.py` prints the stages of the trainings of time_to_bar.py, with kept programs and
with an empty cache.
"""

import itertools
import json
import statistics
import tempfile
import time
from pathlib import Path

from time_to_bar import CODE, DECISIONS, train

STAGES = """import json, time
moments, programs = [("imports", time.time())], []
from archerfish.compiled import import_jax
import_jax().monitoring.register_event_duration_secs_listener(lambda name, spent, **_: programs.append((name, spent)))
from archerfish.learning import learner, run_folder, train
def marked(name, function):
    def call(*arguments):
        moments.append((name, time.time()))
        return function(*arguments)
    return call
for name in ("begin", "advance"):
    setattr(learner.Trainer, name, marked(name, getattr(learner.Trainer, name)))
run_folder.RunFolder.finish = marked("finish", run_folder.RunFolder.finish)
moments.append(("setting", time.time()))
CODE
moments.append(("exit", time.time()))
print(json.dumps([moments, programs]))""".replace("CODE", CODE)
"""A training that prints the moments at which its stages begin, and how long JAX took over programs."""
PROGRAMS = {"tracing": "jaxpr_trace", "lowering": "jaxpr_to_mlir_module", "loading or compiling": "backend_compile"}
"""What the stage `programs` consists of: name → JAX's event."""


def stages(trainer: str, folder: Path, cache: Path) -> dict[str, float]:
    """Return the seconds of each stage of a training."""
    begun = time.time()
    moments, programs = json.loads(train(trainer, 0, folder / "policy", cache, STAGES))
    moments = [("interpreter", begun), *moments, ("", time.time())]
    spent = [(name, end - since) for (name, since), (_, end) in itertools.pairwise(moments)]
    found: dict[str, float] = {}
    for name, seconds in spent:
        found[name] = found.get(name, 0.0) + seconds
    calls = [seconds for name, seconds in spent if name == "advance"]
    training = len(calls) * statistics.median(calls[1:] or [0.0])
    found["programs"] = found.pop("begin") + found.pop("advance") - training
    for name, event in PROGRAMS.items():
        found[f"programs, {name}"] = sum(spent for each, spent in programs if f"/{event}_duration" in each)
    return found | {"training": training, "saving": found.pop("finish"), "exit": found.pop("exit")}


def main() -> None:
    """Train and print."""
    for trainer in DECISIONS:
        with tempfile.TemporaryDirectory() as folder:
            for state in ("compiled", "kept"):
                found = stages(trainer, Path(folder), Path(folder) / "cache")
                print(
                    f"{trainer}, programs {state}",
                    *(f"{name} {seconds:.2f}" for name, seconds in found.items()),
                    sep="  ",
                )


if __name__ == "__main__":
    main()
