"""Logs of every format that is understood, behind one function: the content of a file tells what it is."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from archerfish.records.csv_table import read_text_table
from archerfish.records.errors import file_error
from archerfish.records.log_arrays import read_mat, read_npz
from archerfish.records.log_bags import bag_files, read_bag
from archerfish.records.log_table import LogTable
from archerfish.records.text_file import check_format, check_readable

_BAGS = (b"#ROSBAG V2", b"SQLite format 3\0", b"\x89MCAP")


def read_log(path: Path, inputs: Sequence[str], outputs: Sequence[str], *, time: str | None) -> LogTable:
    """Read the wanted signals of a log: CSV or another text table, .npz, .mat, or a ROS 1 or ROS 2 bag.

    Args:
      path: the file, or the folder of a ROS 2 bag.
      inputs: names of the input signals.
      outputs: names of the output signals.
      time: name of the time column; None for a log without stamps. A bag has its own time.

    Raises:
      InputError: if the log can't be read or a signal is not in it; the error's code tells which fault.
    """
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            problem = "is a folder without metadata.yaml, so no ROS 2 bag"
            raise file_error(path, problem, "pass a log or the folder of a bag", "unknown-format")
        return read_bag(path, inputs, outputs)
    check_readable(path)
    with path.open("rb") as stream:
        start = stream.read(128)
    check_format(path, start)
    if start.startswith(_BAGS) or path.suffix in (".bag", ".db3", ".mcap"):
        return read_bag(path, inputs, outputs)
    wanted = list(dict.fromkeys([*([] if time is None else [time]), *inputs, *outputs]))
    if start.startswith(b"PK\x03\x04") or path.suffix == ".npz":
        table = read_npz(path, wanted)
    elif start.startswith(b"MATLAB 5.0") or path.suffix == ".mat":
        table = read_mat(path, wanted)
    else:
        table = read_text_table(path, wanted)
    return table if time is None else _with_stamps(table, time)


def _with_stamps(table: LogTable, time: str) -> LogTable:
    stamps = table.columns[time]
    return table._replace(stamps=np.asarray(stamps), stamp_name=time)


def log_parts(path: Path) -> list[Path]:
    """Return the files of a log: itself, or those in a bag's folder."""
    return bag_files(path)
