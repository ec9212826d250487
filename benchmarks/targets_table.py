"""The table of docs/targets.md: what the parameters of every motion are drawn from, as `targets.distributions` has it.

    python benchmarks/targets_table.py

It stands between `<!-- distributions -->` and `<!-- /distributions -->`, likewise the weights of the mixture, and
what its variations are drawn from; a test compares.
"""

import re
from pathlib import Path

from archerfish.targets.distributions import TABLE, VARIATION, Distribution
from archerfish.targets.drawn import MIXTURE

PAGE = Path(__file__).parents[1] / "docs" / "targets.md"


def rendered(page: str) -> str:
    """Return the page with its tables as the library has them."""
    for name, lines in (("distributions", distributions()), ("mixture", mixture()), ("variation", variation())):
        table = "\n".join([f"<!-- {name} -->", *lines, f"<!-- /{name} -->"])
        page = re.sub(f"<!-- {name} -->.*<!-- /{name} -->", lambda _, table=table: table, page, flags=re.DOTALL)
    return page


def distributions() -> list[str]:
    """Return a row per motion and parameter."""
    rows = [
        f"| `{motion}` | {name} | {_values(each)} | {each.reason} |"
        for motion, table in TABLE.items()
        for name, each in table.items()
    ]
    return ["| motion | parameter | values | where they come from |", "|---|---|---|---|", *rows]


def _values(each: Distribution) -> str:
    unit = f" {each.unit}" if each.unit not in ("", "°") else each.unit
    if len(each.value) == 2:
        evenly = ", its logarithm even" if each.logarithmic else ""
        return f"{each.value[0]:g} to {each.value[1]:g}{unit}{evenly}".replace("-", "−")
    known = (f"{value:g} at {100 * share:g} %" for share, value in zip(each.share, each.value, strict=True))
    return f"{', '.join(known)}{f', in{unit}' if unit else ''}"


def mixture() -> list[str]:
    """Return a row per motion of `any`."""
    total = sum(MIXTURE.values())
    shown = [
        f"| {'eq (7), as the paper has it' if name == 'paper' else f'`{name}`'} | {100 * weight / total:.1f} % |"
        for name, weight in MIXTURE.items()
    ]
    return ["| motion | of the engagements |", "|---|---:|", *shown]


def variation() -> list[str]:
    """Return a row per parameter of the variations."""
    rows = [f"| {name} | {_values(each)} | {each.reason} |" for name, each in VARIATION.items()]
    return ["| parameter | values | |", "|---|---|---|", *rows]


if __name__ == "__main__":
    PAGE.write_text(rendered(PAGE.read_text()))
