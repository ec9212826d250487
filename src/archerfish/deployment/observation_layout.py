"""What the numbers of an observation are, block by block, in order: for whoever opens an exported policy."""

from archerfish.sensing.multimodel_observation import MultimodelObserver
from archerfish.sensing.observation import Observer
from archerfish.sensing.observers import AnyObserver
from archerfish.sensing.tracked_observation import TrackedObserver


def observation_layout(observer: AnyObserver) -> list[tuple[str, int]]:
    """Return name and size of the blocks of an observation, before it is normalised.

    Args:
      observer: of a policy.

    Raises:
      TypeError: if the observer is of another kind.
    """
    if isinstance(observer, TrackedObserver):
        return _tracked(observer.frames.shape[0] - 1, observer.sights.shape[0], observer.push.shape[0])
    if isinstance(observer, MultimodelObserver):
        return observer.layout
    if isinstance(observer, Observer):
        frames = observer.history.shape[0]
        return _history(frames - 1) if frames else _paper()
    raise TypeError(f"no layout for an observer of type {type(observer).__name__}")


def _paper() -> list[tuple[str, int]]:
    return [
        ("2 × pitch and yaw of the gimbal, a decision ago and now", 4),
        ("2 × yaw of the aim", 1),
        ("(distance − 3 m) / 2", 1),
    ]


def _history(steps: int) -> list[tuple[str, int]]:
    return [
        ("2 × (aim − gimbal), pitch and yaw", 2),
        ("tanh(33.3 × (aim − gimbal)), pitch and yaw", 2),
        ("2 × yaw of the aim", 1),
        ("(distance − 3 m) / 2", 1),
        ("2 × (command − gimbal), a decision ago and now", 4),
        ("10 × moves of the gimbal, oldest first", 2 * steps),
        ("100 × moves of the aim, oldest first", 2 * steps),
        ("100 × changes of the distance, oldest first", steps),
        ("2 × moves of the command, oldest first", 2 * steps),
        ("2 × (aim − where the command would come to rest)", 2),
        ("tanh(33.3 × (aim − where the command would come to rest))", 2),
    ]


def _tracked(moves: int, sights: int, order: int) -> list[tuple[str, int]]:
    return [
        ("2 × (aim − gimbal), pitch and yaw", 2),
        ("tanh(33.3 × (aim − gimbal)), pitch and yaw", 2),
        ("2 × aim, pitch and yaw", 2),
        ("(distance − 3 m) / 2", 1),
        ("5 × target's speed across the line of sight", 1),
        ("2 × (aim − where the command would come to rest)", 2),
        ("tanh(33.3 × (aim − where the command would come to rest))", 2),
        ("2 × (command − gimbal), a decision ago and now", 4),
        ("10 × moves of the gimbal, oldest first", 2 * moves),
        ("2 × moves of the command, oldest first", 2 * moves),
        ("5 × target's speed along the line of sight", 1),
        ("age of the sight and of the feedback / 50 ms", 2),
        ("time since the first sight", 1),
        ("tanh(4 × time since the first sight)", 1),
        ("0.3 / distance", 1),
        ("100 × (last sight's yaw − estimate's)", 1),
        ("20 × distance × (yaw of the last sights − estimate's), oldest first", sights),
        ("10 × distance × Legendre coefficients of the yaw, less the estimate's", order),
    ]
