"""Settings of a training; the one place of their defaults, which follow robot and task."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, structs

from archerfish.controllers.policy.observation import FRAMES
from archerfish.errors import InputError
from archerfish.plugins import registered_name
from archerfish.records.record import Share, Struct
from archerfish.robot import Robot
from archerfish.task import DRAWN, Task

CHUNK = 4
"""Iterations per compiled call of a training; between calls there are checkpoints, and it can be stopped."""
MAX_LOG_STD = 20.0
"""Largest magnitude of a logarithm of a standard deviation: far beyond any that learns."""
MAX_BATCH = 2**20
"""Decisions in a batch; its shuffling needs the rest of 32 bits for random ones."""
SHOWN_SHARE = 0.7
"""Of a task's still targets, with a camera: noise alone makes them move a little, so fewer are enough."""
Rate = Annotated[float, Meta(gt=0.0, le=1e6)]
LogStd = Annotated[float, Meta(ge=-MAX_LOG_STD, le=MAX_LOG_STD)]
Count = Annotated[int, Meta(ge=1, le=MAX_BATCH)]
Steps = Annotated[int, Meta(ge=1, le=10**12)]
Width = Annotated[int, Meta(ge=1, le=8192)]


class _Sized(Struct, frozen=True, kw_only=True):
    """What both trainers' settings have in common."""

    steps: Steps | None = None
    """Decisions to train for, over all environments; rounded to whole batches, then up to calls of four."""
    environments: Count = 128
    """Engagements that run side by side."""
    part: ClassVar[str]  # the field with the decisions of an engagement between two updates

    @property
    def decisions(self) -> int:
        """Decisions of an engagement between two updates."""
        return int(getattr(self, self.part))

    @property
    def batch(self) -> int:
        """Decisions of an iteration, over all environments."""
        return self.environments * self.decisions

    @property
    def iterations(self) -> int:
        """Updates of the whole training."""
        return max(1, round((self.steps or 0) / self.batch))

    @property
    def trained(self) -> int:
        """Decisions of the whole training: `steps`, rounded to whole iterations, then up to whole calls."""
        return -(-self.iterations // CHUNK) * CHUNK * self.batch

    def _check(self, parts: int, number: int, names: str) -> None:
        if number % parts:
            raise InputError(f"{type(self).__name__}: {names} = {number} must divide into {parts} parts; change one")


class GradientConfig(_Sized, frozen=True, kw_only=True):
    """Settings of the analytic policy gradient."""

    part = "window"
    window: Annotated[int, Meta(ge=1, le=1000)] = 16
    """Decisions that a gradient goes back over, and that lie between two updates."""
    shards: Annotated[int, Meta(ge=1, le=64)] = 2
    """Parts that the environments are split into, to keep as many processor cores busy."""
    hidden: Width | None = None
    """Neurons of the first hidden layer of the policy (paper: 256)."""
    layers: Annotated[int, Meta(ge=1, le=8)] = 2
    """Hidden layers, each with half of the neurons of the one before; the paper has one."""
    optimiser: Literal["adam", "muon"] | None = None
    """Adam, or Muon for the matrices of the hidden layers: better where many motions are learned at once."""
    learning_rate: Rate = 3e-3
    """Step of Adam or Muon."""
    anneal: bool = True
    """Whether the learning rate falls linearly, to a twentieth."""
    gradient_norm: Rate = 0.1
    """Gradients are scaled to at most this norm."""
    engagement_norm: Rate = 0.3
    """While it goes back through a window, the gradient of one engagement's rewards [m] by the normalised observation
    is scaled to at most this norm at every decision; a million leaves it as it is."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check(self.shards, self.environments, "environments")
        if self.hidden is not None and self.hidden >> (self.layers - 1) < 1:
            raise InputError(f"GradientConfig: {self.layers} layers halve {self.hidden} neurons to none; take fewer")

    @property
    def widths(self) -> tuple[int, ...]:
        """Neurons of each hidden layer."""
        return tuple((self.hidden or 0) >> layer for layer in range(self.layers))


class PpoConfig(_Sized, frozen=True, kw_only=True):
    """Settings of PPO; the paper's where it prints them."""

    part = "rollout"
    optimiser: ClassVar[str] = "adam"  # (paper)
    environments: Count = 512
    """Engagements that run side by side."""
    rollout: Annotated[int, Meta(ge=1, le=1000)] = 25
    """Decisions per environment between two updates."""
    minibatches: Count = 8
    """Parts that a batch is split into."""
    epochs: Annotated[int, Meta(ge=1, le=1000)] = 4
    """Passes over each batch."""
    shards: Annotated[int, Meta(ge=1, le=64)] = 2
    """Parts that the environments and every minibatch are split into, to keep as many processor cores busy; as a part
    shuffles its own decisions, another number gives other weights."""
    hidden: Width = 256
    """Neurons of the hidden layer of the actor and of the critic (paper)."""
    actor_learning_rate: Rate = 1e-3
    """Adam step of the actor (paper)."""
    critic_learning_rate: Rate = 3e-3
    """Adam step of the critic (paper)."""
    anneal: bool = True
    """Whether the learning rates fall linearly, to a tenth."""
    clip: Rate = 0.2
    """Clipping ε of eq (10) (paper)."""
    discount: Share | None = None
    """γ."""
    trace: Share = 0.9
    """λ of the advantages."""
    entropy: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    """Weight of the entropy bonus."""
    gradient_norm: Rate = 0.5
    """Gradients are scaled to at most this norm, for each network by itself."""
    log_std: LogStd = -1.0
    """Logarithm of the actions' standard deviation at the beginning."""
    log_std_floor: LogStd = -4.0
    """It never falls below this."""

    @property
    def widths(self) -> tuple[int, ...]:
        """Neurons of each hidden layer."""
        return (self.hidden,)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check(self.shards, self.environments, "environments")
        self._check(self.minibatches * self.shards, self.batch, "environments × rollout")
        if self.batch > MAX_BATCH or self.log_std < self.log_std_floor:
            expected = f"environments × rollout of at most {MAX_BATCH}, and log_std of at least log_std_floor"
            raise InputError(f"PpoConfig: expected {expected}, got {self.batch}, and {self.log_std}; correct it")


class TrainConfig(Struct, frozen=True, kw_only=True):
    """Settings of a training; None is filled by `resolved`."""

    trainer: Literal["gradient", "ppo"] | None = None
    """Analytic policy gradient, or PPO as the paper has it."""
    observation: str | tuple[str, ...] | None = None
    """A kind of observation (`controllers.policy.blocks.OBSERVATIONS`), then blocks of a user's own."""
    frames: Annotated[int, Meta(ge=2, le=64)] = FRAMES
    """Decisions that an observation remembers."""
    reward: str = "auto"
    """"eq-8", "hit", "smooth-hit", or one of a user's own; "auto" takes what suits trainer and observation."""
    still_share: Share | None = None
    """Share of targets of eq (7), or of a user's motion, that don't move."""
    gradient: GradientConfig = GradientConfig()
    """Of the analytic policy gradient."""
    ppo: PpoConfig = PpoConfig()
    """Of PPO."""
    checkpoint_every_s: Annotated[float, Meta(ge=0.0, le=1e6)] = 30.0
    """At most so much is lost when the process is killed [s]."""

    def __post_init__(self) -> None:
        if isinstance(self.observation, tuple | list):  # blocks may be functions
            names = [registered_name(block, "block") for block in self.observation]
            structs.force_setattr(self, "observation", tuple(names))
        if callable(self.reward):
            structs.force_setattr(self, "reward", registered_name(self.reward, "reward"))
        super().__post_init__()

    @classmethod
    def of(cls, config: "ConfigLike" = None) -> "TrainConfig":
        """Return settings as `train` and `make_environment` take them.

        Raises:
          InputError: if they are neither settings nor a dictionary of fields, or a field is wrong.
        """
        if config is None or isinstance(config, Mapping):
            return cls(**config or {})
        if not isinstance(config, cls):
            raise InputError(f"config: expected a TrainConfig or a dictionary, got a {type(config).__name__}; give one")
        return config

    @property
    def settings(self) -> Any:
        """Settings of the trainer."""
        return self.ppo if self.trainer == "ppo" else self.gradient

    @property
    def names(self) -> tuple[str, ...]:
        """Kind of observation and blocks of a user's own; of a kind that is not resolved yet nothing."""
        return (self.observation,) if isinstance(self.observation, str) else self.observation or ()

    @property
    def kind(self) -> str:
        """Kind of observation."""
        return (*self.names, "")[0]

    def resolved(self, robot: Robot, task: Task) -> "TrainConfig":
        """Return the settings with a value in the place of every None, for a robot and a task."""
        drawn, late = task.motion in DRAWN, robot.sensing is not None
        usual = "multimodel" if drawn else "tracked" if late else "history"
        made = self.replace(observation=self.observation or usual)
        six = made.kind == "paper"
        made = made.replace(trainer=made.trainer or ("ppo" if six else "gradient"))
        steps, hidden = (18_000_000, 480) if drawn else (8_000_000 if late else 4_000_000, 256)
        if task.motion == "kinds":
            steps = 9_000_000
        gradient = made.gradient.replace(
            steps=made.gradient.steps or steps,
            hidden=made.gradient.hidden or hidden,
            optimiser=made.gradient.optimiser or ("muon" if drawn else "adam"),
        )
        discount = (0.9 if six and late else 0.95) if made.ppo.discount is None else made.ppo.discount
        ppo = made.ppo.replace(steps=made.ppo.steps or (1_200_000 if six and late else 2_000_000), discount=discount)
        if made.still_share is None:
            share = 0.0 if drawn else task.still_share * (SHOWN_SHARE if made.kind == "tracked" else 1.0)
            made = made.replace(still_share=share)
        if made.reward == "auto":
            smooth = "eq-8" if six else "smooth-hit"
            counted = "hit" if made.kind in ("tracked", "multimodel") else "eq-8"
            made = made.replace(reward=smooth if made.trainer == "gradient" else counted)
        return made.replace(gradient=gradient, ppo=ppo)


ConfigLike = TrainConfig | Mapping[str, Any] | None
"""Settings as `train` takes them; see `TrainConfig.of`."""
