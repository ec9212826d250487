"""The page of an identified muzzle: one self-contained HTML file, the verdict first."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.cli.interval_words import ends, with_digits
from archerfish.cli.muzzle_verdict import LABELS, MuzzleVerdict
from archerfish.figures.page import render_page
from archerfish.figures.shot_scatter import ScatterPanel, scatter_figure
from archerfish.figures.shots import ShotGroups, shots_figure
from archerfish.figures.style import svg_text
from archerfish.identification.muzzle.dispersion import dispersion_at
from archerfish.identification.muzzle.likelihood import MuzzleIdentification
from archerfish.records.muzzle import MuzzleRecord
from archerfish.records.shots import Shots, setting_names, settings, vertical_measurement

Array = NDArray[np.float64]

_RANGES_M = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
"""Distances at which the scatter is told [m]."""
_MEANINGS = {
    "speed": "how fast pellets leave, on average",
    "speed_sd": "from shot to shot",
    "pitch_offset": "departure above the barrel's direction, on average",
    "pitch_sd": "from shot to shot",
    "yaw_offset": "departure to the left of the barrel's direction, on average",
    "yaw_sd": "from shot to shot",
    "height": "above the ground on which pellets land, with the barrel level",
    "drag": "quadratic, k in eqs (4) and (5)",
    "length": "by tape; the muzzle rises with the pitch",
}


def shot_groups(shots: Shots, result: MuzzleIdentification) -> ShotGroups:
    """Gather the shots by setting, beside the model.

    Args:
      shots: what the muzzle was identified from.
      result: the identification.
    """
    return ShotGroups(
        settings(shots),
        setting_names(shots),
        vertical_measurement(shots),
        result.expected,
        result.expected_sd,
        result.kept,
    )


def muzzle_page(
    shots: Shots, result: MuzzleIdentification, muzzle: MuzzleRecord, verdict: MuzzleVerdict, name: str
) -> str:
    """Return the page of an identified muzzle.

    Args:
      shots: what it was identified from.
      result: the identification.
      muzzle: the record, with its provenance.
      verdict: what follows.
      name: of the written files.
    """
    groups = shot_groups(shots, result)
    quantity = "Height of the hit" if shots.on_plane else "Landing distance"
    return render_page(
        "muzzle.html",
        title=f"{name.capitalize()}: what the shots say",
        verdict=verdict,
        count=len(shots),
        parameters=list(_parameters(shots, muzzle)),
        spreads=dispersion_at(muzzle, _RANGES_M),
        has_side="yaw_sd" in muzzle.intervals,
        settings=_settings(groups),
        fit=result.lack_of_fit,
        left_out=_left_out(shots, groups),
        findings=result.findings,
        quantity=quantity,
        record=f"{name}.json",
        provenance=muzzle.provenance,
        **_pictures(shots, result, groups, quantity),
    )


def _parameters(shots: Shots, muzzle: MuzzleRecord) -> list[dict[str, str]]:
    rows = []
    for name, (label, unit, scale) in LABELS.items():
        value, interval = getattr(muzzle, name), muzzle.intervals.get(name)
        if name == "length" and not value:
            continue
        unknown = interval is None and (name.startswith("yaw") or (name == "height" and shots.on_plane))
        rows.append(
            {
                "label": label,
                "meaning": _MEANINGS[name],
                "value": "not known" if unknown else f"{with_digits(value, interval, scale)} {unit}",
                "interval": "" if unknown else "given" if interval is None else f"{ends(interval, scale)} {unit}",
            }
        )
    return [each for each in rows if not (shots.on_plane and each["label"] == LABELS["height"][0])]


def _settings(groups: ShotGroups) -> list[dict[str, Any]]:
    rows = []
    for number, name in enumerate(groups.names):
        own = (groups.setting == number) & groups.kept
        lost = int(np.sum((groups.setting == number) & ~groups.kept))
        row: dict[str, Any] = {"name": name, "used": int(own.sum()), "left_out": lost}
        if own.any():
            residual = groups.measured[own] - groups.expected[own]
            row |= {
                "measured": float(groups.measured[own].mean()),
                "model": float(groups.expected[own].mean()),
                "difference_cm": 100 * float(residual.mean()),
                "error_cm": 100 * float(np.sqrt(np.mean(groups.expected_sd[own] ** 2) / own.sum())),
                "scatter_cm": 100 * float(residual.std(ddof=1)) if own.sum() > 1 else None,
                "model_scatter_cm": 100 * float(np.sqrt(np.mean(groups.expected_sd[own] ** 2))),
            }
        rows.append(row)
    return rows


def _left_out(shots: Shots, groups: ShotGroups) -> list[dict[str, Any]]:
    return [
        {
            "place": shots.place(int(index)),
            "setting": groups.names[groups.setting[index]],
            "measured": float(groups.measured[index]),
            "model": float(groups.expected[index]),
            "deviations": float((groups.measured[index] - groups.expected[index]) / groups.expected_sd[index]),
        }
        for index in np.flatnonzero(~groups.kept)
    ]


def _pictures(shots: Shots, result: MuzzleIdentification, groups: ShotGroups, quantity: str) -> dict[str, Any]:
    by_setting = shots_figure(groups, title=quantity, quantity=quantity)
    pictures: dict[str, Any] = {
        "by_setting": svg_text(by_setting, prefix="settings", label="Shots and model by setting"),
        "scatter": None,
    }
    panels = _scatter_panels(shots, result, groups)
    if panels:
        figure = scatter_figure(panels, quantity="Height" if shots.on_plane else "Distance")
        pictures["scatter"] = svg_text(figure, prefix="scatter", label="Where the shots of each setting went")
    return pictures


def _scatter_panels(shots: Shots, result: MuzzleIdentification, groups: ShotGroups) -> list[ScatterPanel]:
    if shots.lateral is None:
        return []
    panels = []
    azimuth = result.muzzle.yaw_offset + (shots.yaw if shots.on_plane else 0.0 * shots.yaw)
    for number, name in enumerate(groups.names):
        own = groups.setting == number
        # With measured speeds each shot has a mean of its own; the picture shows them all about one.
        ahead, moved = float(groups.expected[own].mean()), float(groups.expected[own].var())
        distance = float(shots.distance[own & groups.kept].mean()) if (own & groups.kept).any() else ahead
        aside = float((distance * np.tan(azimuth[own])).mean())
        sd = distance * result.muzzle.yaw_sd, float(np.sqrt(moved + np.mean(groups.expected_sd[own] ** 2)))
        panels.append(
            ScatterPanel(name, shots.lateral[own], groups.measured[own], groups.kept[own], (aside, ahead), sd)
        )
    return panels
