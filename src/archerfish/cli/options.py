"""How options look in --help: placeholders, and defaults in words where no value tells them."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

JsonFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")]
"""A file that is written only if it is given."""
Switch = Annotated[bool, tyro.conf.arg(help_behavior_hint="")]
"""What is done unless --no-NAME is given; --help shows that flag, so the words below it say what leaving out does."""
OwnMotionName = Annotated[str, tyro.conf.arg(metavar="NAME", help_behavior_hint="(default: as eq (7) says)")]
"""A target motion of a user's own."""
Folder = Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
"""A folder for results."""
PaperTarget = Literal["paper", "static", "dynamic"]
"""One of `scenario.TARGETS`."""
DrawnTarget = Literal["any", "still", "parabola", "pass", "strafe", "stop-and-go", "sinusoid", "circle", "singer"]
"""One of `drawn.DRAWN`."""
Observation = Literal["history", "paper", "tracked", "multimodel"]
"""A kind of observation."""
