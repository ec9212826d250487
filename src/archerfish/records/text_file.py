"""Lines of a text log, whatever wrote it: byte order marks, UTF-16, and zero bytes that a power cut left at the end."""

import codecs
from pathlib import Path
from typing import NamedTuple

from archerfish.records.errors import file_error
from archerfish.records.log_table import MAX_BYTES

_WIDE = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_UNREAD = {
    b"\x1f\x8b": ("is compressed", "unpack it first"),
    b"\x28\xb5\x2f\xfd": ("is compressed", "unpack it first"),
    b"\xfd7zXZ\0": ("is compressed", "unpack it first"),
    **{b"BZh%d1AY&SY" % level: ("is compressed", "unpack it first") for level in range(1, 10)},
    b"\x89HDF": ("is an HDF5 file (MATLAB 7.3)", "save it with -v7, or as CSV"),
    b"\x93NUMPY": ("is a single NumPy array", "store the signals by name with numpy.savez"),
}
"""First bytes of files that no reader of logs understands."""
_ARCHIVE = b"PK\x03\x04"
_PADDING = "\0\x1a"
"""What is no text after the last line: zero bytes, and the end mark of DOS."""


class TextLines(NamedTuple):
    """What a text file holds."""

    lines: list[str]
    """Its lines, without what ends them."""
    finished: bool
    """Whether a line break ends the last one."""
    zero_bytes: int
    """Zero bytes after the last line: samples can have stood there."""


def check_readable(path: Path, limit: int = MAX_BYTES) -> None:
    """Fail before reading what is no file or would fill the memory.

    Raises:
      InputError: if there is no regular file or it is larger than `limit` bytes.
    """
    try:
        size = path.stat().st_size
    except FileNotFoundError as error:
        raise file_error(path, "no such file", "check the path", "no-such-file") from error
    except OSError as error:
        raise file_error(path, f"can't be read ({error.strerror})", "check the path", "unreadable") from error
    if not path.is_file():
        raise file_error(path, "is not a file", "pass a file that holds a log", "unreadable")
    if size > limit:
        problem = f"holds {size / 2**20:.0f} MB, where at most {limit / 2**20:.0f} MB are read"
        raise file_error(path, problem, "cut the log into shorter ones", "too-large")


def check_format(path: Path, start: bytes) -> None:
    """Fail on what no reader of logs understands.

    Args:
      path: the file.
      start: its first bytes.

    Raises:
      InputError: if it is compressed, HDF5, or a single array.
    """
    for magic, (problem, remedy) in _UNREAD.items():
        if start.startswith(magic):
            raise file_error(path, problem, remedy, "unknown-format")


def read_lines(path: Path) -> TextLines:
    """Return the lines of a text file, and how it ends.

    A line ends with a line feed, a carriage return or both, and with nothing else: a form feed or a Unicode separator
    inside a field is no end of a sample. A byte order mark shows UTF-8 (spreadsheets) and UTF-16 (their "Unicode
    text"). Zero bytes at the end are what some file systems leave after a power cut, in place of what was written last.
    A substitute character is the end mark of DOS.

    Raises:
      InputError: if the file is missing, too large, empty, or not text.
    """
    check_readable(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise file_error(path, f"can't be read ({error.strerror})", "check its permissions", "unreadable") from error
    check_format(path, content)
    if content.startswith(_ARCHIVE):
        problem = "is an archive (.npz, .zip, or a spreadsheet), expected text"
        raise file_error(path, problem, "save the table as CSV", "unknown-format")
    decoded = _decoded(path, content)
    text = decoded.rstrip(_PADDING)
    zeros = decoded.count("\0", len(text)) * (2 if content.startswith(_WIDE) else 1)
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        remedy = "save the log as UTF-8 text, or remove the damaged lines"
        raise file_error(path, f"line {line}: holds zero bytes, so it is not text", remedy, "zero-bytes")
    if not text.strip():
        raise file_error(path, "is empty", "pass a log whose first line names the columns", "empty")
    finished = text.endswith("\n")
    return TextLines(text.removesuffix("\n").split("\n"), finished, zeros)


def _decoded(path: Path, content: bytes) -> str:
    encoding = "utf-16" if content.startswith(_WIDE) else "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        line = content[: error.start].decode(encoding, "ignore").count("\n") + 1
        name = encoding.removesuffix("-sig").upper()
        problem = f"line {line}: can't be read as {name} text (byte {error.start})"
        remedy = "save the log as UTF-8 text, or pass one of the formats in docs/logs.md"
        raise file_error(path, problem, remedy, "encoding") from error
