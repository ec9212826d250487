"""Everything that a controller, target, block, reward or world of your own needs; these names stay.

    from archerfish.authors import aim, first_detection, intercept, namespace

docs/bring_your_own.md has an example of each noun, and tables of the fields of `Seen`, `Shot` and `View`.

- **Arrays**: `namespace(x)`, NumPy or JAX as x is; `select(condition, one, other)` of whole trees;
  `map_arrays(function, tree)`; `tree()`, which makes a class compiled, as a NamedTuple is.
- **A controller** (`Controller`) gets a `Seen`: its `GimbalFeedback`, `Frames`, `Base` and `Barrel`; `Truth` only if it
  has `needs_truth = True`. It returns a `Command`; `aim(angle)` makes one that fires. `first_detection(seen)` is the
  nearest plate of the latest frame, a `Detection`; `update_with_frames` folds a tracker over all frames. `aim_at` has
  the angles for a place at rest, `intercept` those for one that moves. A tracker alone is a `Predictor`; `DirectAim`
  and `make_preview_aim` aim with any. `Player` makes a controller of a model with `predict`.
- **A target** has `position(time)` and is made by a function of place, speed and uniform draws, or is a `Target`, whose
  `at(time)` returns `Plates`.
- **A block** of an observation is a function of an `Observer` and its `View` of a decision.
- **A reward** (`RewardFunction`) is a function of a `Shot`, a `Command` and what is seen after it.
- **A wire** decodes frames of bytes, described by `Layout`s, into `WireReports` with the gimbal's `Feedback`, and
  encodes commands; docs/deployment.md has an example.
- **A world** (`World`) lets an `Engagement` pass decision by decision; `af.make_world` makes one that can be wrapped.
"""

from archerfish.arrays import map_arrays, namespace, select, tree
from archerfish.controllers.aiming.direct import DirectAim
from archerfish.controllers.aiming.preview_lq import make_preview_aim
from archerfish.controllers.policy.observer import Observer, View
from archerfish.controllers.predictors.predictor import Predictor
from archerfish.dynamics.aiming import aim_at, intercept
from archerfish.learning.player import Player
from archerfish.learning.reward import RewardFunction
from archerfish.messages import Feedback
from archerfish.protocols import (
    Barrel,
    Base,
    Command,
    Controller,
    Engagement,
    Frames,
    GimbalFeedback,
    Plates,
    Seen,
    Shot,
    Target,
    Truth,
    World,
    aim,
)
from archerfish.tracking.detections import Detection, first_detection, update_with_frames
from archerfish.wires.layout import Layout
from archerfish.wires.wire import WireReports

__all__ = [
    "Barrel", "Base", "Command", "Controller", "Detection", "DirectAim", "Engagement", "Feedback", "Frames",
    "GimbalFeedback", "Layout", "Observer", "Plates", "Player", "Predictor", "RewardFunction", "Seen", "Shot", "Target",
    "Truth", "View", "WireReports", "World",
    "aim", "aim_at", "first_detection", "intercept", "make_preview_aim", "map_arrays", "namespace", "select", "tree",
    "update_with_frames",
]  # fmt: skip
