"""What `import archerfish2` costs over bare Python, and which large libraries it loads.

Pairs of processes alternate, and medians are compared: `python benchmarks2/import_time.py`. The goal is at most 50 ms
and none of the libraries.
"""

import json
import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAIRS = 9
LARGE = ("numpy", "jax", "scipy", "matplotlib", "gymnasium")


def run(code: str) -> tuple[float, str]:
    """Return the duration of a Python process [s] and what it prints."""
    begun = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return time.perf_counter() - begun, done.stdout


def main() -> None:
    """Measure, print and write results/import_time.json."""
    loaded = run(f"import archerfish2, sys; print(*(name for name in {LARGE!r} if name in sys.modules))")[1].split()
    pairs = [(run("pass")[0], run("import archerfish2")[0]) for _ in range(PAIRS)]
    bare, ours = (statistics.median(each) for each in zip(*pairs, strict=True))
    results = {"pairs": PAIRS, "bare_s": round(bare, 4), "over_bare_s": round(ours - bare, 4), "loaded": loaded}
    print(json.dumps(results))
    path = ROOT / "benchmarks2" / "results" / "import_time.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
