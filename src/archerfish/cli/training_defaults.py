"""What `archerfish train` takes where the command line does not say: it follows the targets that are trained for."""

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from archerfish.learning.gradient_config import GradientConfig
from archerfish.records.errors import InputError
from archerfish.simulation.scenario import TARGETS
from archerfish.targets.drawn import ANY, DRAWN

if TYPE_CHECKING:
    from archerfish.cli.train import Train

DRAWN_STEPS, DRAWN_HIDDEN = 9_000_000, 512
"""Settings of training by gradients for targets whose motion is drawn: more is to be learned than for eq (7)."""


@dataclass(frozen=True)
class GradientOptions(GradientConfig):
    """Settings of training by gradients."""

    steps: int = 0
    """Decisions to train for, over all environments; rounded to whole windows, then up to calls of four. 0 takes as
    many as the targets need: 500,000 for the paper's, 9,000,000 for others."""
    hidden: int = 0
    """Neurons of the first hidden layer of the policy (paper). 0 takes as many as the targets need: 256 for the
    paper's, 512 for others."""

    def __post_init__(self) -> None:
        GradientConfig(**_filled(self, GradientConfig.steps, GradientConfig.hidden))

    def settled(self, target: str) -> "GradientOptions":
        """Return the settings without a 0.

        Args:
          target: that is trained for.
        """
        if target in DRAWN:
            return GradientOptions(**_filled(self, DRAWN_STEPS, DRAWN_HIDDEN))
        return GradientOptions(**_filled(self, GradientConfig.steps, GradientConfig.hidden))


def _filled(options: GradientOptions, steps: int, hidden: int) -> dict[str, Any]:
    return {**asdict(options), "steps": options.steps or steps, "hidden": options.hidden or hidden}


def resolved(command: "Train") -> "Train":
    """Return a command with a value for each option that was left to the targets; what was given stays.

    Raises:
      InputError: if a motion of the user's own is given, and targets that have another one.
    """
    target: Any = command.target or ("paper" if command.motion else ANY)
    drawn = target in DRAWN
    if command.motion and drawn:
        raise InputError(
            f"--motion takes the place of eq (7), by which --target {target} does not move; leave one of the two out, "
            f"or say --target {' or '.join(TARGETS)}"
        )
    seen: Any = "multimodel" if drawn else "history" if command.setting.sensing is None else "tracked"
    return replace(
        command,
        target=target,
        observation=command.observation or seen,
        trainer=command.trainer or ("gradient" if drawn else "ppo"),
        gradient=command.gradient.settled(target),
    )
