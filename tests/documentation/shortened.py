"""Commands of the pages, made short: fewer steps, engagements and samples than a reader is told to take."""

import re
from collections.abc import Sequence

TRAINING = {
    "--ppo.steps": "80",
    "--ppo.environments": "8",
    "--ppo.rollout": "6",
    "--ppo.hidden": "4",
    "--gradient.steps": "100",
    "--gradient.environments": "4",
    "--gradient.window": "3",
    "--gradient.hidden": "4",
}
PPO_ALONE = {name: value for name, value in TRAINING.items() if name.startswith("--ppo")}
GRADIENT_ALONE = {name: value for name, value in TRAINING.items() if name.startswith("--gradient")}
LINEAR = {"--physics": "linear"}

SHORTER: dict[str, dict[str, str | None]] = {
    "train": {"--target": "paper", **PPO_ALONE, "--no-tensorboard": None},
    "train --target any": {"--target": "still", **GRADIENT_ALONE, "--no-tensorboard": None},
    "train --target paper": {**PPO_ALONE, "--no-tensorboard": None},
    "train --target dynamic": {**PPO_ALONE, "--no-tensorboard": None},
    "train --motion": {**PPO_ALONE, "--no-tensorboard": None},
    "train --trainer gradient": {**GRADIENT_ALONE, "--no-tensorboard": None},
    "train --resume": {},
    "sweep": {**TRAINING, "--engagements": "2", "--in-process": None},
    "evaluate": {"--engagements": "2", "--controllers": "kalman"},
    "evaluate --target": {"--target": "still", "--engagements": "2", "--controllers": "no-lead"},
    "record sweep": {"--duration-s": "3", **LINEAR},
    "record step": {"--hold-s": "0.5", **LINEAR},
    "record timing": {"--duration-s": "6", "--count": "6", **LINEAR},
    "range": {"--burst": "10", **LINEAR},
    "identify gimbal": {"--order": "2"},
}
"""Beginning of a command → options that take the place of what the page has; None for a flag."""
FEWER = {"--trials": "1"}
"""Options that are cut where the page has them, and not added where it has not."""


def shortened(words: Sequence[str], sampler: bool = True) -> list[str]:
    """Return a command's words with the options that make it short; a user's own controllers stay.

    Args:
      words: without the program's name.
      sampler: whether Optuna is there; without it the two ends of a range stand for what would be sampled from it.
    """
    if not sampler and "--trials" in words:
        at = words.index("--trials")
        words = [re.sub(r"=([^=]+)\.\.([^:]+)(:log)?$", r"=\1,\2", word) for word in (*words[:at], *words[at + 2 :])]
    beginning = max((each for each in SHORTER if _begins(words, each)), key=len, default="")
    changes = {**SHORTER.get(beginning, {}), **{name: value for name, value in FEWER.items() if name in words}}
    own = [word for word in words if re.fullmatch(r"\S+:[A-Z]\w+", word)] if "--controllers" in words else []
    kept, dropping = [], False
    for word in words:
        dropping = word in changes or (dropping and not word.startswith("--"))
        kept += [] if dropping else [word]
    for name, value in changes.items():
        kept += [name, *([] if value is None else [value]), *(own if name == "--controllers" else [])]
    return kept


def _begins(words: Sequence[str], beginning: str) -> bool:
    first, *rest = beginning.split()
    return words[0] == first and all(each in words for each in rest)
