"""The names of our environments in Gymnasium: importing this module registers them.

    import gymnasium
    import archerfish.simulation.registration

    gymnasium.make("archerfish/Shooting-v0", plant="runs/infantry", target="dynamic")

All take the options of `assembly.make_environment`; `archerfish/Shooting-v0` also takes an environment in their place.
"""

import gymnasium

ENVIRONMENTS: dict[str, dict[str, str]] = {
    "archerfish/Shooting-v0": {},
    "archerfish/ShootingBox-v0": {"command_limit": "box"},
}
"""Name → options that are not the defaults."""

_HERE = "archerfish.simulation"

for _name, _options in ENVIRONMENTS.items():
    # No time limit of Gymnasium's: an engagement knows its length.
    gymnasium.register(
        _name,
        entry_point=f"{_HERE}.gymnasium_env:ShootingEnv",
        vector_entry_point=f"{_HERE}.vector_env:ShootingVectorEnv",
        kwargs=_options,
    )
