"""`archerfish report`: a page from stored results."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from archerfish.cli.options import Ending, shown
from archerfish.errors import file_error
from archerfish.evaluation.results import Results
from archerfish.records.json_files import read_json
from archerfish.studies.study import Study


@dataclass(frozen=True)
class WriteReport:
    """Write the page of stored results again, and print them.

    - reads results.json of archerfish evaluate, transfer or reproduce; computes nothing again

    Examples:
      archerfish report runs/reproduce
      archerfish report my-robot/evaluation --out page.html
    """

    results: Annotated[tyro.conf.Positional[Path], shown("FOLDER|FILE.json")]
    """results.json, or its folder."""
    out: Annotated[Path | None, shown("FILE.html")] = None
    """The page; report.html beside the results if not given."""

    def run(self, _: str = "") -> Ending:
        """Read, write."""
        path = self.results if self.results.suffix == ".json" else self.results / "results.json"
        out = self.out or path.with_name("report.html")
        content = read_json(path, "evaluate again")
        schema = content.get("schema") if isinstance(content, dict) else None
        if schema not in (Results.schema, Study.schema):
            expected = f'expected "{Results.schema}" or "{Study.schema}", got {schema!r}'
            raise file_error(path, f"field schema: {expected}", "name results of evaluate, transfer or reproduce")
        page = (Study if schema == Study.schema else Results).load(path).report
        robots = (folder / "robot.html" for folder in (path.parent / "robot", *path.absolute().parents[1:3]))
        page.linked(out, robots).write_page(out)
        return Ending(f"{page}", f"open {out}")
