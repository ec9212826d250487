"""Which muzzle parameters a set of shots can separate, said before they are estimated."""

from collections.abc import Collection

import numpy as np

from archerfish.records.errors import InputError
from archerfish.records.shots import Shots

_REMEDIES = {
    "speed": "measure the muzzle speed of each shot (column speed_m_s)",
    "height": "measure the muzzle's height above the ground (--height-m)",
    "drag": "give the drag coefficient (--drag-per-m)",
}


def pitch_settings(shots: Shots) -> int:
    """Return at how many different pitch angles the shots were fired."""
    return int(np.unique(np.round(shots.pitch, 6)).size)


def check_shots(shots: Shots, free: Collection[str]) -> None:
    """Refuse shots that can't separate the free parameters.

    Each parameter that shapes the mean distance needs a pitch setting of its own: at one setting a faster pellet and a
    higher barrel land alike.

    Args:
      shots: the shots.
      free: parameters to be estimated, as in a muzzle record.

    Raises:
      InputError: with the measurement that is missing.
    """
    shaping = [name for name in ("speed", "pitch_offset", "height", "drag") if name in free]
    if shots.speed is not None:
        shaping.remove("speed")
    settings, needed = pitch_settings(shots), len(shaping)
    if settings < needed:
        remedies = [_REMEDIES[name] for name in shaping if name in _REMEDIES]
        raise InputError(
            f"{shots.source or 'shots'}: {settings} pitch setting{'s' * (settings > 1)} can't separate "
            f"{' from '.join(name.replace('_', ' ') for name in shaping)}; "
            f"{', or '.join([*remedies, f'shoot at {needed} pitch settings'])}"
        )
    # Two standard deviations are estimated beside the parameters of the mean.
    if len(shots) < needed + 3:
        raise InputError(
            f"{shots.source or 'shots'}: {len(shots)} shots are too few for {needed} parameters of the mean distance "
            f"and two standard deviations; shoot at least {needed + 3}, better 20 at each pitch setting"
        )
