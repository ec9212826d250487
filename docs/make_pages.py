"""Make the tutorials' pages and examples/notebook.ipynb from the scripts, and api.md from the public names.

`python docs/make_pages.py` writes them; a test compares the files with what this returns.
"""

import inspect
import json
import re
from pathlib import Path

import archerfish as af

PAGES, EXAMPLES = Path(__file__).parent, Path(__file__).parents[1] / "examples"


def cells(script):
    """Return the cells of a script in percent format, as pairs: whether it is prose, and its text."""
    parts = re.split(r"^# %%(.*)\n", script, flags=re.MULTILINE)[1:]
    pairs = [(bool(kind), text.strip()) for kind, text in zip(parts[::2], parts[1::2], strict=True)]
    return [(prose, re.sub(r"^# ?", "", text, flags=re.MULTILINE) if prose else text) for prose, text in pairs]


def page(path):
    """Return a tutorial as a page of Markdown."""
    blocks = [text if prose else f"```python\n{text}\n```" for prose, text in cells(path.read_text())]
    return "\n\n".join([*blocks, f"This page is made from the script `examples/{path.name}`, which you can run.\n"])


def notebook(path):
    """Return a tutorial as the text of a Jupyter notebook, without outputs."""
    listed = []
    for number, (prose, text) in enumerate(cells(path.read_text())):
        kind = {"cell_type": "markdown"} if prose else {"cell_type": "code", "execution_count": None, "outputs": []}
        listed.append({"id": f"cell-{number}", "metadata": {}, "source": text.splitlines(keepends=True)} | kind)
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return json.dumps({"cells": listed, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}, indent=1) + "\n"


def api():
    """Return the page of the public names: a table of all, then what mkdocstrings makes of each."""
    names = sorted(set(af.__all__) - {"__version__"}, key=lambda name: (not name.islower(), name))
    rows = ["| name | what it does |", "|---|---|"]
    for name in names:
        arguments = ", ".join(inspect.signature(getattr(af, name)).parameters) if name.islower() else ""
        summary = inspect.getdoc(getattr(af, name)).split("\n\n")[0].replace("\n", " ")
        rows.append(f"| `{name}({arguments})` | {summary} |" if name.islower() else f"| `{name}` | {summary} |")
    heading = "# API\n\nThe names of `import archerfish as af`: verbs first, then types. `help(af.train)` explains one."
    authors = "`archerfish.authors` has what a controller, target, block, reward or world of your own needs."
    details = ["::: archerfish", "    options:", f"      members: [{', '.join(names)}]"]
    return "\n".join([heading, authors, "", *rows, "", *details, ""])


def made():
    """Return the text of each file that is made, by its path."""
    scripts = sorted(EXAMPLES.glob("tutorial_*.py"))
    pages = {PAGES / f"{'_'.join(path.stem.split('_')[:2])}.md": page(path) for path in scripts}
    return pages | {EXAMPLES / "notebook.ipynb": notebook(scripts[0]), PAGES / "api.md": api()}


if __name__ == "__main__":
    for place, content in made().items():
        place.write_text(content)
