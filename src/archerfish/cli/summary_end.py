"""How every summary of an identification ends: its remarks, and what was written."""

from rich.console import Console


def print_end(console: Console, remarks: list[str], files: list[str]) -> None:
    """Print remarks, each a sentence, and the files that were written."""
    for remark in remarks:
        console.print(f"• {remark}", markup=False, highlight=False)
    console.print(f"wrote {', '.join(files)}", markup=False, highlight=False)
