"""Lines of a text log, whatever wrote it: byte order marks, UTF-16, and zero bytes that a power cut left at the end."""

import codecs
from pathlib import Path

from archerfish.records.errors import file_error
from archerfish.records.log_table import MAX_BYTES

_WIDE = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


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


def read_lines(path: Path) -> tuple[list[str], bool]:
    """Return the lines of a text file, and whether the last one is finished by a line break.

    A byte order mark tells UTF-8 (spreadsheets) and UTF-16 (their "Unicode text"). Zero bytes at the end are what some
    file systems leave after a power cut: nothing was written there.

    Raises:
      InputError: if the file is missing, too large, empty, or not text.
    """
    check_readable(path)
    try:
        content = path.read_bytes()
        text = content.decode("utf-16" if content.startswith(_WIDE) else "utf-8-sig")
    except OSError as error:
        raise file_error(path, f"can't be read ({error.strerror})", "check its permissions", "unreadable") from error
    except UnicodeDecodeError as error:
        remedy = "save the log as UTF-8 text, or pass one of the formats in docs/logs.md"
        raise file_error(path, f"can't be read as UTF-8 text (byte {error.start})", remedy, "encoding") from error
    text = text.rstrip("\0")
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        remedy = "save the log as UTF-8 text, or remove the damaged lines"
        raise file_error(path, f"line {line}: holds zero bytes, so it is not text", remedy, "zero-bytes")
    if not text.strip():
        raise file_error(path, "is empty", "pass a log whose first line names the columns", "empty")
    return text.splitlines(), text.endswith(("\n", "\r"))
