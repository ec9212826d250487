"""What imports cost: `import archerfish` over bare Python, and a policy on a robot, imported and loaded, over NumPy.

Processes take turns, and medians are compared: `python benchmarks/import_time.py`. Goals: at most 50 ms for the
package, which loads no large library, and at most 80 ms for the policy, where only NumPy is installed. Writes
results/import_time.json.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from policies import untrained

ROOT = Path(__file__).parents[1]
PAIRS = 9
LARGE = ("numpy", "jax", "scipy", "matplotlib", "gymnasium")
BLOCKED = f"import sys; sys.modules.update(dict.fromkeys({LARGE[1:]!r}))"
CODES = {
    "bare": "pass",
    "package": "import archerfish",
    "numpy": f"{BLOCKED}; import numpy",
    "policy": f"{BLOCKED}; import numpy; from archerfish.controllers.policy.policy import Policy; Policy.load('PATH')",
}


def run(code: str) -> tuple[float, str]:
    """Return the duration of a Python process [s] and what it prints."""
    environment, begun = {**os.environ, "PYTHONPATH": str(ROOT / "src")}, time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    return time.perf_counter() - begun, done.stdout


def main() -> None:
    """Measure, print and write."""
    loaded = run(f"import archerfish, sys; print(*(name for name in {LARGE!r} if name in sys.modules))")[1].split()
    times: dict[str, list[float]] = {name: [] for name in CODES}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.safetensors"
        untrained("multimodel").controller.save(path)
        for _ in range(PAIRS):
            for name, code in CODES.items():
                times[name].append(run(code.replace("PATH", str(path)))[0])
    found = {name: statistics.median(every) for name, every in times.items()}
    results = {
        "pairs": PAIRS,
        "bare_s": round(found["bare"], 4),
        "over_bare_s": round(found["package"] - found["bare"], 4),
        "policy_over_numpy_s": round(found["policy"] - found["numpy"], 4),
        "loaded": loaded,
    }
    print(json.dumps(results))
    path = ROOT / "benchmarks" / "results" / "import_time.json"
    path.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
