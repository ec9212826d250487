"""Who trains beside us: the packages with PPO that install from PyPI and take our environment."""

from peers.roster import Tool

OURS = Tool("Archerfish", "archerfish_train.py", {})
SB3 = Tool("Stable-Baselines3", "sb3_train.py", {}, "sb3.txt")
SBX = Tool("SBX", "sbx_train.py", {}, "sbx.txt")
BRAX = Tool("Brax", "brax_train.py", {}, "brax.txt")
RLTOOLS = Tool("RLtools", "rltools_train.py", {}, "rltools.txt")
TRAINERS = (OURS, SB3, SBX, BRAX, RLTOOLS)
WITHOUT_POLICY = (RLTOOLS,)
"""Whose policies come out as source of another language: their speed is measured, not what they learn."""
DIFFERENCES = {
    SB3.name: "one learning rate; clips actor and critic as one; rolls out in NumPy through our vector environment",
    SBX.name: "one learning rate; rolls out in NumPy through our vector environment",
    BRAX.name: "one learning rate that does not fall; values weigh half; masks the step at which time is up",
    RLTOOLS.name: "one learning rate that does not fall; steps our environment one at a time from C++; no BLAS",
}
"""Tool → what it does otherwise."""
