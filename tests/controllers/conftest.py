"""A small duel: any controller in the simulation, in NumPy, step by step."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from archerfish.controllers.roster import Workbench
from archerfish.dynamics.array_namespace import map_arrays
from archerfish.dynamics.command_limits import named_limits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.sensing.interfaces import Seen
from archerfish.simulation.scenario import UNIFORMS, draw_engagement
from archerfish.simulation.setting import make_scenario, make_world, paper_muzzle
from archerfish.simulation.shooting import DRAWS

CONDITIONS = assumed_conditions()


class Duel(NamedTuple):
    """What happened at every decision, shape (T,) first."""

    seen: Seen
    """What the controller saw before it."""
    command: Any
    """What it asked for [rad]."""
    allowed: Any
    """What the limits made of that [rad]."""
    angle: Any
    """Where the gimbal pointed when it fired [rad]."""
    miss: Any
    """Pellet minus armor in y and z [m]."""
    truth: Any
    """What the oracle was told."""


@pytest.fixture(scope="session")
def bench() -> Callable[[str], Workbench]:
    """Build what controllers are built from, under a command limit."""
    plants = printed_plants()
    model = gimbal_model(plants["pitch"], plants["yaw"], CONDITIONS.control_period_s)
    muzzle = muzzle_from_record(paper_muzzle(CONDITIONS))

    def build(command_limit: str) -> Workbench:
        limits = named_limits(command_limit, gate_limits(), CONDITIONS.line_of_sight_lead)
        return Workbench(model, muzzle, limits, CONDITIONS)

    return build


@pytest.fixture(scope="session")
def fight() -> Callable[..., Duel]:
    """Let a controller fight a batch of engagements without dispersion."""
    plants = printed_plants()

    def duel(
        controller: Any,
        command_limit: str = "gate",
        static_share: float = 1.0,
        batch: int = 6,
        steps: int = CONDITIONS.decisions,
        range_m: tuple[float, float] = (1.0, 5.0),
    ) -> Duel:
        world = make_world(**plants, muzzle=paper_muzzle(CONDITIONS), limits=gate_limits(), command_limit=command_limit,
                           conditions=CONDITIONS)  # fmt: skip
        uniforms = np.random.default_rng(21).random((batch, UNIFORMS), np.float32)
        engagements = draw_engagement(make_scenario(CONDITIONS, range_m, static_share), uniforms)
        truth = world.truth(engagements)
        shooting, seen = world.reset(engagements, np.zeros((batch, steps, DRAWS), np.float32))
        state, moments = controller.reset(seen, truth), []
        for _ in range(steps):
            before = seen
            state, command = controller.step(state, before)
            shooting, seen, shot = world.step(shooting, command)
            moments.append((before, command.angle, seen.command, shot.angle, shot.miss))
        return Duel(*map_arrays(lambda *each: np.stack(each), *moments), truth)

    return duel
