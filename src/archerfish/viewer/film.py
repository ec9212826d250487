"""A trial as one HTML file that plays in any browser: no server, no network, no other file."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.errors import file_error
from archerfish.storage import check_regular, write_bytes
from archerfish.viewer.choice import Setup, TrialChoice
from archerfish.viewer.motions import FloatArray
from archerfish.viewer.trial import Trial, trial_text

FILM_MARK = '<meta name="generator" content="archerfish view">'
"""In every film, and in no other file."""
ELLIPSE_SCALE = math.sqrt(-2.0 * math.log(0.05))
"""Half axes of the ellipse that holds 95 % of a normal distribution, in standard deviations."""
_DIGITS = 5  # hundredths of a millimetre and of a milliradian


def check_film(path: Path) -> None:
    """Refuse a name that is none of a page, and to replace what is no film.

    Raises:
      InputError: saying which.
    """
    if path.suffix != ".html":
        raise file_error(path, "expected a name that ends with .html", "choose such a name")
    check_regular(path)
    if path.exists() and FILM_MARK.encode() not in path.read_bytes()[:2000]:
        raise file_error(path, "was not written by archerfish view", "name another file, or remove it")


def write_film(path: Path, setup: Setup, choice: TrialChoice, trial: Trial) -> None:
    """Write a trial as a film.

    Raises:
      InputError: if it can't be written, or something else is in its place.
    """
    import jinja2

    check_film(path)
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string(Path(__file__).with_name("film.html").read_text(encoding="utf-8"))
    film = film_content(setup, choice, trial)
    text = json.dumps(film, allow_nan=False).replace("<", "\\u003c")  # so that no text ends the script
    write_bytes(path, template.render(film=film, text=text).encode())


def film_content(setup: Setup, choice: TrialChoice, trial: Trial) -> dict[str, Any]:
    """Return what a film shows, for JSON: lengths in m, angles in rad, times in s, names of fields with their unit."""
    text = f"{choice.motion}, {choice.distance:g} m, seed {choice.seed}: {trial_text(trial)}, 95 % over engagements"
    return {
        "schema": "archerfish.film/1",
        "title": f"{choice.controller} on the robot {setup.robot.name}",
        "text": f"{text}. {setup.note(choice.controller)}",
        "period_s": trial.period_s,
        "shown_s": round(trial.shown_s, 9),
        "hit_radius_m": trial.hit_radius,
        "distance_m": choice.distance,
        "drag": float(trial.muzzle.drag),
        "ellipse_m": ellipse(trial, choice.distance),
        "engagements": [_engagement(trial, number) for number in range(len(trial.hit))],
    }


def ellipse(trial: Trial, distance: float) -> Any:
    """Return half axes, up and left [m], of the ellipse of 95 % of a perfect aim's pellets at a distance [m]."""
    return _listed(distance * ELLIPSE_SCALE * np.asarray(trial.muzzle.sd))


def _engagement(trial: Trial, number: int) -> dict[str, Any]:
    """Return the fields of an engagement; null stands for a shot that was not fired or crosses nothing."""
    fields = {"gimbal": trial.angle, "command": trial.command, "plate": trial.place, "error": trial.error}
    fields |= {"flight_time": trial.flight_time, "miss": trial.miss, "start": trial.start, "velocity": trial.velocity}
    listed = {name: _listed(values[number]) for name, values in fields.items()}
    return {"motion": trial.motions[number], "hit": trial.hit[number].tolist(), **listed}


def _listed(values: FloatArray) -> Any:
    rounded = np.round(values.astype(np.float64), _DIGITS)
    return np.where(np.isfinite(rounded), rounded, np.array(None)).tolist()
