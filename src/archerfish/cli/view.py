"""`archerfish view`: a page in the browser to play with engagements, or a film of them."""

import importlib.util
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from archerfish.cli.options import Ending, ForRobot, shown
from archerfish.controllers.registry import is_policy
from archerfish.errors import InputError
from archerfish.viewer.choice import Setup, TrialChoice, first_choice, make_setup
from archerfish.viewer.film import check_film, write_film
from archerfish.viewer.trial import run_trial, trial_text


@dataclass(frozen=True)
class ViewRobot(ForRobot):
    """Open a page in the browser to play with engagements, or write a film of them.

    - shows robot, pellets, plate, hits and misses, the aim error and the hit rate with its interval; choose controller,
      motion, distance, speed, dispersion and latency, and drag the target by hand (docs/viewer.md)
    - is for this machine alone: the page has no address outside of it
    - classical controllers have the settings that evaluate keeps for ROBOT and the task; the page says so where there
      are none
    - with --export writes one HTML file, which plays without a server and without a network, and ends

    Examples:
      archerfish view
      archerfish view my-robot
      archerfish view my-robot --task strafe --controller kalman-lq --distance-m 4
      archerfish view my-robot --export film.html
    """

    controller: Annotated[str, shown("NAME|FOLDER", "(default: ROBOT/policy, or kalman)")] = ""
    """Who shoots first, as archerfish evaluate takes it; the page offers the classical ones, too."""
    distance_m: Annotated[float | None, shown("METRES", "(default: the middle of the task's)")] = None
    """Distance of the targets, 1–8 m."""
    engagements: int = 16
    """In a trial, of the task's first length each."""
    seed: int = 0
    """Of targets and dispersion."""
    port: int = 8080
    """Of the page; 0 for any free one."""
    export: Annotated[Path | None, shown("FILE")] = None
    """Film to write, NAME.html, instead of the page."""

    def run(self, _: str = "") -> Ending | None:
        """Serve until Ctrl-C, or write the film."""
        if self.export is not None:
            check_film(self.export)
        elif not all(map(importlib.util.find_spec, ("viser", "websockets"))):
            raise InputError("the page needs viser, which is not installed; pip install 'archerfish[view]'")
        robot, task = self.robot_and_task()
        first = [self.controller] if self.controller else []
        own = [] if is_policy(self.controller) else self.own_policy()
        setup = make_setup(robot, task, [*first, *own, "kalman"])
        distance = {} if self.distance_m is None else {"distance": self.distance_m}
        choice = first_choice(setup, engagements=self.engagements, seed=self.seed, **distance)
        trial = run_trial(setup, choice)  # a controller that can't be used is refused before anything is shown
        lines = [f"{choice.controller}, {choice.motion}, {choice.distance:g} m: {trial_text(trial)}"]
        found = "\n".join([*lines, *filter(None, [setup.note(choice.controller)])])
        if self.export is None:
            self._serve(setup, choice, found)
            return None
        write_film(self.export, setup, choice, trial)
        words = [str(self.robot)] if self.folder else []
        return Ending(
            found, f"open {self.export}; it needs no other file", shlex.join(["archerfish", "export", *words])
        )

    def _serve(self, setup: Setup, choice: TrialChoice, found: str) -> None:
        from archerfish.viewer.page import Page, serve_page  # needs viser
        from archerfish.viewer.server import page_server

        with page_server(self.port) as server:
            page = Page(server, setup, choice)
            address = f"http://127.0.0.1:{server.get_port()}"
            print(f"{found}\n\nopen {address}; Ctrl-C ends it. Nothing is written", flush=True)  # noqa: T201
            serve_page(server, page)
