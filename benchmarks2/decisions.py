"""A policy on a robot: the time until it is imported and loaded, and that of a decision in NumPy.

`python benchmarks2/decisions.py` reads a policy of each kind of the first edition from ../shared, and compares its own
decision on the same situations with the first's without fallback (goal: at most 1.1 of it), in pairs; and measures
`from archerfish2.controllers.policy.policy import Policy` in a process of its own, where JAX and SciPy can't be
imported (goal: at most 80 ms over `import numpy`). Writes results/decisions.json.
"""

import json
import os
import platform
import runpy
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT.parent / "shared" / "second_edition" / "reference"
PAIRS, DECISIONS = 15, 200
BLOCKED = "import sys; sys.modules.update(dict.fromkeys(('jax', 'scipy', 'matplotlib', 'gymnasium')));"
IMPORTS = {
    "numpy": "import numpy",
    "policy": "import numpy; from archerfish2.controllers.policy.policy import Policy; Policy.load('PATH')",
}


def import_times(path: Path) -> dict[str, float]:
    """Return the median time of each import in a process of its own [ms]."""
    found: dict[str, list[float]] = {name: [] for name in IMPORTS}
    for _ in range(PAIRS):
        for name, code in IMPORTS.items():
            code = code.replace("PATH", str(path))
            timed = f"{BLOCKED} import time; t = time.perf_counter(); {code}; print(time.perf_counter() - t)"
            environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
            run = subprocess.run(
                [sys.executable, "-c", timed], capture_output=True, text=True, check=True, env=environment
            )
            found[name].append(1e3 * float(run.stdout))
    return {name: round(statistics.median(each), 1) for name, each in found.items()}


def decision_time(controller: Any, seen: list[Any]) -> float:
    """Return the mean time of a decision [ms]."""
    state = controller.reset(seen[0])
    begun = time.perf_counter()
    for number in range(DECISIONS):
        state, _ = controller.step(state, seen[number % len(seen)])
    return 1e3 * (time.perf_counter() - begun) / DECISIONS


def main() -> None:
    """Measure, print, write."""
    if not REFERENCE.is_dir():
        raise SystemExit(f"this reads policies of the first edition, and {REFERENCE} is not there")
    tests = runpy.run_path(str(ROOT / "tests2" / "against_first" / "test_policies.py"))
    rows: dict[str, dict[str, float]] = {}
    second: Any = None
    for kind, name in tests["POLICIES"].items():
        folder = REFERENCE / "policies" / name
        first = tests["policy_from_record"](tests["read_policy"](folder / "policy.json"))
        sensing = REFERENCE / "infantry" / "sensing.json" if "infantry" in name else None
        shown = tests["recorded"](first, sensing and tests["read_sensing"](sensing), ())
        own: list[Any] = [tests["seen_of"](each) for each in shown]
        second = tests["read_first"](folder)
        pairs: list[list[float]] = []
        for number in range(PAIRS):
            runs = ((first, shown), (second, own))
            times = [decision_time(*each) for each in (runs if number % 2 else runs[::-1])]
            pairs.append(times if number % 2 else times[::-1])
        one, other = np.median(np.array(pairs), axis=0).tolist()
        ratio = statistics.median(b / a for a, b in pairs)
        rows[kind] = {"first_ms": round(one, 3), "second_ms": round(other, 3), "ratio": round(ratio, 3)}
        print(f"{kind:12} first {one:7.3f} ms   second {other:7.3f} ms   ratio {ratio:5.3f}", flush=True)
    saved = Path("/tmp") / f"archerfish-policy-{os.getpid()}.safetensors"
    second.save(saved)
    imports = import_times(saved)
    saved.unlink()
    over = imports["policy"] - imports["numpy"]
    print(f"import and load: {imports['policy']} ms, {over:.1f} ms over NumPy's {imports['numpy']} ms")
    conditions = {"pairs": PAIRS, "cores": os.cpu_count(), "machine": platform.machine()}
    found: dict[str, Any] = {
        "conditions": conditions,
        "import_ms": imports,
        "over_numpy_ms": round(over, 1),
        "decision": rows,
    }
    (Path(__file__).parent / "results" / "decisions.json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
