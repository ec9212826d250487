"""Policies of each kind of observation that nobody trained, as large as those of a training with default settings."""

import itertools
from typing import NamedTuple

import numpy as np

import archerfish as af
from alternating import ROOT
from archerfish.codegen.decision import Gated
from archerfish.controllers.policy.network import Layer, Normaliser
from archerfish.controllers.policy.observation import make_observer, observer_facts
from archerfish.controllers.policy.policy import PolicyFacts
from archerfish.safety.rules import gate_rules


class Kind(NamedTuple):
    """What a kind of observation is used for."""

    infantry: bool  # whether the robot is that of tests/infantry, rather than the paper's
    task: str
    hidden: tuple[int, ...]  # neurons of each hidden layer


KINDS = {
    "paper": Kind(infantry=False, task="paper", hidden=(256,)),
    "history": Kind(infantry=False, task="paper", hidden=(256, 128)),
    "tracked": Kind(infantry=True, task="paper", hidden=(256, 128)),
    "multimodel": Kind(infantry=True, task="any", hidden=(480, 240)),
}


def untrained(name: str) -> Gated:
    """Return a policy with random weights, whose commands keep the limits of its robot."""
    infantry, task_name, hidden = KINDS[name]
    robot = af.Robot.load(ROOT / "tests" / "infantry") if infantry else af.Robot.paper()
    task, rng = af.Task.load(task_name), np.random.default_rng(4)
    facts = observer_facts(name, robot, task)
    observer = make_observer(facts)
    widths = [sum(size for _, size in observer.layout()), *hidden, 2]
    layers = []
    for size, count in itertools.pairwise(widths):
        weights = rng.normal(0.0, size**-0.5, (size, count)).astype(np.float32)
        layers.append(Layer(weights, np.zeros(count, np.float32)))
    normaliser = Normaliser(np.zeros(widths[0], np.float32), np.ones(widths[0], np.float32), np.float32(0.0))
    policy = af.Policy(observer, normaliser, tuple(layers), PolicyFacts(observer=facts, task=task, robot={}))
    return Gated(policy, gate_rules(robot, task))
