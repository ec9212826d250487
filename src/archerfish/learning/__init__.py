"""Training of policies: PPO and the analytic policy gradient, run folders, and environments for other libraries."""

import sys

ID = "archerfish/Shooting-v0"
"""Of the environments in Gymnasium."""


def register_environments() -> None:
    """Register the environments in Gymnasium if that is loaded, by name alone: nothing else is loaded for it."""
    gymnasium, place = sys.modules.get("gymnasium"), f"{__name__}.gymnasium:Shooting"
    if gymnasium is not None and getattr(gymnasium.registry.get(ID), "entry_point", "") != f"{place}Env":
        gymnasium.register(ID, entry_point=f"{place}Env", vector_entry_point=f"{place}VectorEnv")
