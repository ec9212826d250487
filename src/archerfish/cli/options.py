"""How options look in --help: placeholders, and defaults in words where no value tells them."""

from pathlib import Path
from typing import Annotated

import tyro

JsonFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")]
"""A file that is written only if it is given."""
Folder = Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
"""A folder for results."""
