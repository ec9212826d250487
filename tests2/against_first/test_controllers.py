"""Commands and plans of the classical controllers, decision by decision, on what the first edition's world showed."""

from typing import Any

import numpy as np
import pytest

from archerfish.controllers import roster
from archerfish.dynamics.array_namespace import map_arrays as map_first
from archerfish.dynamics.command_limits import named_limits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records.sensing import read_sensing
from archerfish.sensing.kalman_filter import noise_from_record
from archerfish.simulation.scenario import UNIFORMS, draw_engagement
from archerfish.simulation.setting import make_scenario, make_world, paper_muzzle
from archerfish2.arrays import map_arrays, register, single_precision
from archerfish2.controllers.registry import make_controller
from archerfish2.controllers.tuning import Tuning, tuning_at
from archerfish2.protocols import Barrel, Base, Frames, GimbalFeedback, Seen, Truth
from archerfish2.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish2.robot import Robot
from archerfish2.targets.motion import Parabola, disc
from archerfish2.task import Task

pytestmark = pytest.mark.against_first
CONDITIONS, PLANTS = assumed_conditions(), printed_plants()
NAMES = ("kalman", "kalman-lq", "imm-lq", "parabola-lq", "no-lead", "oracle")


def seen_of(seen: Any) -> Seen:
    """What the first edition's controllers see, as one frame with one slot."""
    zero, found = 0.0 * seen.elapsed, seen.fresh[..., None]
    position = np.where(found[..., None], seen.plate[..., None, :, :], np.float32(0.0))
    frames = Frames(seen.fresh, seen.plate_age, found, position, 0.0 * seen.normal_yaw[..., None])
    base = Base(0.0 * position[..., 0, 0, :], 0.0 * position[..., 0, 0, :], zero, zero)
    gimbal, barrel = GimbalFeedback(seen.angle, seen.rate, seen.gimbal_age), Barrel(seen.muzzle_speed, seen.heat_left)
    return Seen(seen.elapsed, gimbal, seen.command, frames, base, barrel)


def decide(controller: Any, seen: Any, truth: Any) -> Any:
    """Commands on what was seen, shape (T,) + B + (2,)."""
    state, commands = controller.reset(seen[0], truth), []
    for each in seen:
        state, command = controller.step(state, each)
        commands.append(command.angle)
    return np.stack(commands)


def decide_compiled(jit: Any, controller: Any, seen: Any, truth: Any, mapped: Any) -> Any:
    import jax

    def run(controller, seen):
        first = mapped(lambda each: each[0], seen)
        return jax.lax.scan(controller.step, controller.reset(first, truth), seen)[1].angle

    stacked = mapped(lambda *each: jax.numpy.asarray(np.stack(each)), *seen)
    return np.asarray(jit(run)(jax.tree.map(jax.numpy.asarray, controller), stacked))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("setting", ["gate", "box", "sensing"])
def test_commands_and_plans_are_those_of_the_first_edition(name, setting, reference, quick_jit) -> None:
    if (name, setting) == ("oracle", "sensing"):
        pytest.skip("the oracle sees nothing")
    register()
    limit, sensing = (
        ("gate", read_sensing(reference / "infantry" / "sensing.json")) if setting == "sensing" else (setting, None)
    )
    muzzle = paper_muzzle(CONDITIONS)
    world = make_world(**PLANTS, muzzle=muzzle, limits=gate_limits(), command_limit=limit, conditions=CONDITIONS,
                       sensing=sensing)  # fmt: skip
    rng = np.random.default_rng(21)
    uniforms = rng.random((16, UNIFORMS), np.float32)
    engagement = draw_engagement(make_scenario(CONDITIONS, (1.0, 5.0), 0.3), uniforms)
    tuning = tuning_at(name) if name != "no-lead" else Tuning(acceleration_sd=4.0)
    noise = noise_from_record(sensing, 1.0) if sensing else None
    model = gimbal_model(PLANTS["pitch"], PLANTS["yaw"], 0.02, (sensing and sensing.link.command_latency) or 0.0)
    limits = named_limits(limit, gate_limits(), CONDITIONS.line_of_sight_lead)
    settings = roster.Tuning(**{each: getattr(tuning, each) for each in tuning.__struct_fields__})
    bench = roster.Workbench(model, muzzle_from_record(muzzle), limits, CONDITIONS, noise, settings)
    first = roster.make_controller(name, bench)

    robot, task = Robot.paper(), Task.load("paper").replace(command_limit=limit, lengths_s=(1.0,))
    if sensing:
        camera = CameraRecord(**vars(sensing.camera))  # whose elevation the first edition gives the azimuth's noise
        camera = camera.replace(elevation_sd=camera.bearing_sd)
        robot = robot.replace(sensing=SensingRecord(camera=camera, link=LinkRecord(**vars(sensing.link))))
    second = make_controller(name, robot, task, tuning)

    truth = world.truth(engagement)
    target = disc(Parabola(*(getattr(truth.motion, each) for each in Parabola._fields)), truth.motion.vertex)
    ours = single_precision(Truth(target, robot.gimbal(0.02), robot.muzzle_model())) if name == "oracle" else None
    state, seen = world.reset(engagement, rng.standard_normal((16, 50, world.normals if sensing else 6), np.float32))
    memory, shown, commands = first.reset(seen, truth), [], []
    for _ in range(50):
        shown.append(seen)
        memory, command = first.step(memory, seen)
        state, seen, _ = world.step(state, command)
        commands.append(command.angle)

    frames = [seen_of(each) for each in shown]
    # A draw of hypotheses that rounding moves from one to its neighbour moves the aim by a share of their distance.
    tolerance = {"oracle": 1e-4, "parabola-lq": 5e-3 if sensing else 1e-5}.get(name, 1e-5)
    np.testing.assert_allclose(decide(second, frames, ours), np.stack(commands), rtol=0, atol=tolerance)
    found = decide_compiled(quick_jit, second, frames, ours, map_arrays)
    expected = decide_compiled(quick_jit, first, shown, truth if name == "oracle" else None, map_first)
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)
