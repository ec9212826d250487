"""Tables of the policy for any target: of the suite `motions`, of eq (7), and of motions that no training has."""

from collections.abc import Iterable
from typing import Any

from markdown_table import markdown

WHO_AT_MOTIONS = {
    "policy": "policy",
    "history": "policy for eq (7) alone",
    "one setting": "best classical, one setting",
    "tuned per motion": "best classical, tuned for each",
}
"""Name in the cells of benchmarks/motions.py → heading."""


def motions(results: dict[str, Any], setting: str) -> str:
    """Write hit rates in percent against each motion, means over ranges and trainings, of 1 s and of 3 s.

    Args:
      results: of benchmarks/motions.py.
      setting: of the cells.
    """
    found = [each for each in results["cells"] if each["setting"] == setting]
    names = list(dict.fromkeys(each["motion"] for each in found))
    rows = []
    for motion in (*names, "all"):
        rates = []
        for name in WHO_AT_MOTIONS:
            for table in dict.fromkeys(each["table"] for each in found):
                mine = [
                    each
                    for each in found
                    if (each["controller"], each["table"]) == (name, table) and motion in ("all", each["motion"])
                ]
                rates.append(f"{100 * sum(map(_share, mine)) / len(mine):.1f}")
        rows.append([motion, *(" / ".join(pair) for pair in zip(rates[::2], rates[1::2], strict=True))])
    return markdown(["motion", *WHO_AT_MOTIONS.values()], rows)


def motion_differences(results: dict[str, Any]) -> str:
    """Write how far the policies are above their rivals, in points: a row per setting, training and rival.

    Args:
      results: of benchmarks/motions.py.
    """
    rows = [
        [
            row["setting"],
            str(row["training_seed"]),
            WHO_AT_MOTIONS[against],
            *(f"{row[against][name]:+.1f}".replace("-", "−") for name in ("mean_points", "least_points")),
            f"{row[against]['least_lower_end']:+.1f}".replace("-", "−"),
            row[against]["moving_cells_clear_of_zero"],
        ]
        for row in results["verdicts"]
        for against in ("one setting", "tuned per motion")
    ]
    headings = (
        "in",
        "training",
        "less",
        "mean of 64 cells",
        "least",
        "lowest end of an interval",
        "moving cells clear of zero",
    )
    return markdown(headings, rows)


def eq7(results: dict[str, Any]) -> str:
    """Write by how many points the policies are behind the one for eq (7), on eq (7): eight cells in a row.

    Args:
      results: of benchmarks/motions.py.
    """
    found = results["eq7"]["comparisons"]
    rows = []
    for setting, seed in dict.fromkeys((each["setting"], each["policy_seed"]) for each in found):
        mine = [100 * each["difference"] for each in found if _trained(each) == (setting, seed)]
        points = " ".join(f"{each:+.1f}".replace("-", "−") for each in mine)
        rows.append([setting, str(seed), f"{sum(mine) / len(mine):+.1f}".replace("-", "−"), points])
    headings = ("in", "training", "mean", "still 1–2, 2–3, 3–4, 4–5 m, then moving")
    return markdown(headings, rows)


def unseen(results: dict[str, Any]) -> str:
    """Write by how many points the policies are above the best classical controller of each unseen motion.

    Args:
      results: of benchmarks/unseen_motions.py.
    """
    found = results["differences"]
    rows = []
    for motion in dict.fromkeys(each["motion"] for each in found):
        row = [motion]
        for table in dict.fromkeys(each["table"] for each in found):
            mine = [each for each in found if (each["motion"], each["table"]) == (motion, table)]
            # Trainings are averaged, cells are not: the least is one cell's mean.
            ranges = dict.fromkeys(tuple(each["range_m"]) for each in mine)
            means = [_mean(each["difference"] for each in mine if tuple(each["range_m"]) == place) for place in ranges]
            points = (f"{100 * each:+.1f}".replace("-", "−") for each in (_mean(means), min(means)))
            row += [*points, f"{100 * _mean(each['fallback_share'] for each in mine):.1f} %"]
        rows.append(row)
    return markdown(
        ["motion", *(f"{length}: {what}" for length in ("1 s", "3 s") for what in ("mean", "least", "fell back"))], rows
    )


def _trained(each: dict[str, Any]) -> tuple[str, int]:
    return each["setting"], each["policy_seed"]


def _share(cell: dict[str, Any]) -> float:
    return float(cell["hits"] / (cell["shots"] + cell["withheld"]))


def _mean(values: Iterable[float]) -> float:
    found = list(values)
    return sum(found) / len(found)
