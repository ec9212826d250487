"""The numbers that the paper prints, those that it leaves open, and how we read its damaged parts.

The numbers are in the JSON files beside the modules, with their legibility; nothing printed is typed anywhere else.
docs/paper.md has the reasons for our readings.
"""

import functools
from pathlib import Path
from typing import Any, Literal

from archerfish.records.json_files import read_json

Legibility = Literal["clear", "damaged", "absent"]
"""Read as printed; printed, but not as it can have been meant; or not printed, so that the value is our assumption."""


@functools.cache
def facts(name: str) -> dict[str, Any]:
    """Return the content of a JSON file beside this module, for instance "tables"."""
    return dict(read_json(Path(__file__).with_name(f"{name}.json")))
