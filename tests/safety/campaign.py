"""Random sequences of inputs to the gate, and a monitor that judges what is sent by arithmetic of its own, in float64.

The monitor judges by the order of the decisions: each is a period after the last one, or, after a gap of 1.5 periods,
the command stood still in between.
"""

import collections

import numpy as np

from archerfish.safety.gate import GateInput, GateState, gate, resting_gate

F = np.float32
ABSURD = [np.nan, np.inf, -np.inf, 1e30, -1e5]
AGES = [0.001, 0.01, 0.02, 0.049, 0.0501, 0.0999, 0.1001, 0.5, 1e9, -0.005, -0.011, -1.0, np.nan, np.inf]
PLATE_AGES = [0.03, 0.04, 0.249, 0.251, 2.0, np.nan, -0.1, 1e9]
SHOTS = [1e6, 1.0, 0.99, 0.0, np.nan]
INTERVAL, SETTLING = 0.06, 0.3


def start(rng, rules, n):
    """Return states of which most are armed and moving, so that every state is reached."""
    low, high = rules.limits.low, rules.limits.high
    armed = rng.random(n) < 0.7
    command = (low + (high - low) * rng.uniform(0.1, 0.9, (n, 2))).astype(F)
    flag, good_for = armed.astype(F), np.where(armed, F(0.6), F(0.49))
    started = {"mode": flag, "switch_on": flag, "sent_for": flag, "good_for": good_for}
    return resting_gate(command)._replace(obstacle=10 * (1 - flag), **started)


def inputs(rng, rules, state, calm, base_yaw):
    """Return inputs near the limits of what is allowed; those of calm sequences are mostly good."""
    n, period = len(calm), float(rules.period)
    low, high = rules.limits.low, rules.limits.high

    def pick(values, share, usual):
        rare = rng.random(n) < np.where(calm, share, 0.3)
        return np.where(rare, rng.choice(np.float32(values), n), F(usual))

    def vector(values, share):
        rare = rng.random((n, 1)) < np.where(calm, share, 0.3)[:, None]
        return np.where(rare, rng.choice(np.float32(ABSURD), (n, 2)), values).astype(F)

    near = state.command + rng.normal(0.0, 0.008, (n, 2))
    wide = low + (high - low) * rng.uniform(-0.5, 1.5, (n, 2))
    edge = np.where(rng.random((n, 2)) < 0.5, low, high)
    kind = rng.integers(10, size=(n, 1))
    desired = np.select([kind < 7, kind < 9], [near, wide], edge)
    gaps = [period * each for each in (0.49, 0.51, 0.9, 1.1, 1.49, 1.51)]
    return GateInput(
        elapsed=pick([*gaps, 0.049, 0.051, 0.2, 1.0, 0.0, -1.0, np.nan, np.inf], 0.02, period),
        desired=vector(desired, 0.01),
        fire=rng.random(n) < 0.8,
        switch_on=rng.random(n) > np.where(calm, 0.02, 0.3),
        angle=vector(state.command + rng.normal(0.0, 0.02, (n, 2)), 0.01),
        feedback_age=pick(AGES, 0.02, 0.002),
        plate_age=pick(PLATE_AGES, 0.05, 0.03),
        base_yaw=pick(ABSURD, 0.01, 0.0) + base_yaw,
        shots_left=pick(SHOTS, 0.05, 1e6),
        plausible=rng.random(n) > np.where(calm, 0.002, 0.05),
    )


class Monitor:
    """Counts what must never happen, `wrong`, and how often the robot did what, `done`."""

    def __init__(self, robot, period, state):
        axes = robot.limits.pitch, robot.limits.yaw
        self.low, self.high = np.array([(axis.low, axis.high) for axis in axes]).T
        self.rate, self.acceleration = np.array([(axis.max_rate, axis.max_acceleration) for axis in axes]).T
        self.period, self.command = period, state.command.astype(float)
        self.speed = np.zeros(state.command.shape)
        self.sent = state.mode > 0
        self.base, self.quiet = np.zeros((2, len(state.mode)))
        self.sent_for = state.sent_for.astype(float)
        self.wrong, self.done = collections.Counter(), collections.Counter()

    def judge(self, given, verdict):
        """Judge a decision."""
        angle, mode, fire = verdict.angle.astype(float), verdict.mode, verdict.fire
        given = GateInput(*(np.asarray(each, float) for each in given))
        idle = (given.switch_on == 0) | ~self.sent
        plausible = np.abs(given.base_yaw) <= 1e3
        plausible &= idle | (np.abs(given.base_yaw - self.base) <= 0.5)
        base = np.where(plausible, given.base_yaw, self.base)
        turned = np.stack([0.0 * base, base], axis=-1)
        sent, both = mode > 0, self.sent & (mode > 0)
        gap = ~((given.elapsed > 0.0) & (given.elapsed < 1.5 * self.period))
        before = np.where((gap | ~self.sent)[:, None], 0.0, self.speed)
        # A range that turns with the chassis carries the command along: that is no motion of its own.
        low, high = self.low + turned, self.high + turned
        last = np.minimum(np.maximum(self.command, low), high)
        speed = np.where(both[:, None], angle - last, 0.0) / self.period
        # Where the end of the range turns towards a moving command, staying in the range comes first.
        stop = before**2 / (2.0 * self.acceleration) + np.abs(before) * self.period
        cut_off = (np.minimum(angle - low, high - angle) <= stop) & (
            turned != np.stack([0.0 * base, self.base], axis=-1)
        )
        change = np.where(cut_off, 0.0, np.abs(speed - before))
        turns_back = (np.abs(speed) > np.abs(before) + 1e-3) | (speed * before < -1e-3)
        elapsed = np.where(np.isfinite(given.elapsed), np.maximum(given.elapsed, 0.0), 0.1)
        elapsed = np.where(elapsed > 0.0, elapsed, 0.1)
        self.quiet += elapsed
        self.sent_for = np.where(both, self.sent_for + np.minimum(elapsed, self.period), 0.0)
        faults = {
            "not finite": ~np.isfinite(angle),
            "range": sent[:, None] & ((angle < low - 2e-6) | (angle > high + 2e-6)),
            "rate": both[:, None] & (np.abs(speed) > self.rate * (1.0 + 1e-4)),
            "acceleration": both[:, None] & (change > self.acceleration * self.period * (1.0 + 1e-4) + 1e-4),
            "held, not braking": both[:, None] & (mode >= 2)[:, None] & turns_back,
            "fires on old feedback": fire & ~((given.feedback_age <= 0.05) & (given.feedback_age >= -0.0101)),
            "fires while not armed": fire & ((mode != 1) | (given.switch_on == 0)),
            "fires at an unseen plate": fire & ~((given.plate_age <= 0.2501) & (given.plate_age >= -0.0101)),
            "fires too hot": fire & ~(given.shots_left >= 1.0),
            "fires while settling": fire & (self.sent_for < SETTLING - 1e-3),
            "fires too soon": fire & (self.quiet < INTERVAL - 1e-3),
            "arms without the switch": (mode == 1) & (given.switch_on == 0),
        }
        for name, found in faults.items():
            self.wrong[name] += int(found.sum())
        self.quiet[fire] = 0.0
        for name, found in {"fired": fire, "armed": mode == 1, "held": mode == 2, "in fault": mode == 3}.items():
            self.done[name] += int(found.sum())
        self.command, self.speed, self.sent, self.base = angle, np.where(sent[:, None], speed, 0.0), sent, base


def campaign(robot, rules, n, decisions, seed, step=gate, compare=lambda *_: None):
    """Run n sequences through a gate; return the monitor.

    Args:
      robot: whose limits the monitor keeps.
      rules: of the gate.
      n: of sequences.
      decisions: of each.
      seed: of the inputs.
      step: the gate.
      compare: gets each decision's input and verdict, of all sequences.
    """
    rng = np.random.default_rng(seed)
    rules = rules._replace(interval=F(INTERVAL))
    state = start(rng, rules, n)
    monitor, calm = Monitor(robot, float(rules.period), state), rng.random(n) < 0.8
    turns, base_yaw = np.where(rng.random(n) < 0.3, rng.normal(0.0, 0.1, n), 0.0), np.zeros(n, F)
    for _ in range(decisions):
        base_yaw = (base_yaw + turns).astype(F)
        given = inputs(rng, rules, state, calm, base_yaw)
        state, verdict = step(rules, state, given)
        monitor.judge(given, verdict)
        compare(given, verdict)
    assert isinstance(state, GateState)
    return monitor
