"""`archerfish look`: what is in a log, before it is identified."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from archerfish.cli.options import Ending, Writes, shown
from archerfish.logs.look import log_report, names_to_fill_in
from archerfish.logs.recording import log_files


@dataclass(frozen=True)
class Look(Writes):
    """Show what is in a log: its signals with rates, ranges, units, gaps and repeats, and a picture.

    - takes every format that identify axis takes; units with a question mark are guessed
    - writes look.html; of a folder of logs that are named otherwise than identify expects, a logs.toml to fill in, and
      run.json

    Examples:
      archerfish look log.mcap
      archerfish look logs --out runs/names
    """

    log: Annotated[tyro.conf.Positional[Path], shown("FILE|BAG|FOLDER")]
    """Log, or folder of a bag or of logs."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/look")
    """Folder for what is written."""

    def run(self, options: str = "") -> Ending:
        """Read, write; `options` are as typed, for run.json."""
        name = "look.html" if log_files(self.log) else "logs.toml"
        with self.written(self.out, f"look {name}", options, [self.log], [name]) as folder:
            if name == "look.html":
                found = log_report(self.log)
                found.write_page(folder / name)
                return Ending(f"{found}", f"open {self.out / name}")
            text = names_to_fill_in(self.log)
            (folder / name).write_text(text, encoding="utf-8")
        following = f"correct it, move it into {self.log}, and archerfish identify {self.log}"
        return Ending(text.rstrip(), f"this is {self.out / name}", following)
