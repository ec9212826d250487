"""What printers of a traced decision share: names of its scalars, and the content of the template of a language."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from archerfish.codegen.decision import FIELDS, TRUTHS, Decision
from archerfish.codegen.trace import Network, Symbol, schedule


class Printer:
    """Steps of a schedule as a template takes them, and the tables of its networks."""

    def __init__(self, number: Callable[[Any], str]) -> None:
        """Take what writes a constant."""
        self.number, self.tables, self._numbers = number, list[Any](), dict[Any, int]()

    def scalars(self, values: Sequence[Any]) -> list[str]:
        """Return the names of symbols and the texts of numbers."""
        return [f"t{each.number}" if isinstance(each, Symbol) else self.number(each) for each in values]

    def content(self, step: Any) -> dict[str, Any]:
        """Return what a template needs of a step of a schedule, by its kind: float, bool, network or loop."""
        if isinstance(step, Symbol):
            first, *places = step.arguments
            of: Any = first if isinstance(first, str) else self._numbers.get(first)
            made = {"kind": "bool" if step.is_bool else "float", "name": f"t{step.number}", "places": places}
            return made | {"operation": step.operation, "of": self.scalars(step.arguments) if of is None else of}
        whole: Any = step if isinstance(step, Network) else step[0]
        number = self._numbers[whole] = len(self._numbers)
        if isinstance(step, Network):
            begin = len(self.tables)
            self.tables += [table for layer in step.layers for table in layer]
            layers = [(begin + 2 * at, *weight.shape) for at, (weight, _) in enumerate(step.layers)]
            return {"kind": "network", "w": number, "vector": self.scalars(step.vector), "layers": layers}
        rows, lists = [self.scalars(row) for row in whole.items], ("begin", "after", "given")
        values = {name: self.scalars(getattr(whole, name)) for name in lists}
        return {"kind": "loop", "w": number, "rows": rows, "body": [self.content(each) for each in step[1]], **values}


def printed(template: str, printer: Printer, decision: Decision, facts: Mapping[str, Any]) -> str:
    """Fill the template of a language.

    Args:
      template: name of its file.
      printer: new; afterwards it has the tables.
      decision: what is decided.
      facts: what else the template takes.
    """
    import jinja2

    truths = [decision.fire, decision.refused]
    outputs = {"angle": decision.angle, "truths": truths, "codes": decision.codes, "memory": decision.memory}
    content: dict[str, Any] = {name: printer.scalars(values) for name, values in outputs.items()}
    steps = schedule([each for values in outputs.values() for each in values])
    content["steps"] = [printer.content(each) for each in steps]
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    content["fire"], content["refused"] = content["truths"]
    text = Path(__file__).with_name(template).read_text(encoding="utf-8")
    return (
        environment.from_string(text).render(**content, **facts, fields=FIELDS, booleans=TRUTHS, tables=printer.tables)
        + "\n"
    )
