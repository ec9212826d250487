"""What every identification returns: a record, the report on it, and how both are shown and saved."""

from pathlib import Path
from typing import Any

from archerfish2.reports.report import Reported


class Result(Reported):
    """Base of the results of an axis, a muzzle and a sensing."""

    record: Any
    """What was identified: a `PlantRecord`, `MuzzleRecord` or `SensingRecord`."""

    @property
    def part(self) -> str:
        """Name of the part of a robot, and of its files."""
        raise NotImplementedError

    def save(self, folder: str | Path) -> None:
        """Write PART.json, the record, and PART.html, its page, into a folder that exists.

        Raises:
          InputError: if a file can't be written.
        """
        self.record.save(Path(folder) / f"{self.part}.json")
        self.report.write_page(Path(folder) / f"{self.part}.html")
