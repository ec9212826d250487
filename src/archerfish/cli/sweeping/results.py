"""What is known of every trial: results.jsonl, a line per trial, each written once; results.csv for other programs."""

import csv
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from archerfish.cli.sweeping.trial import CellHits, TrialDone
from archerfish.evaluation.pooling import Estimate, weighted_mean
from archerfish.evaluation.typed_json import from_json
from archerfish.records.errors import InputError, file_error
from archerfish.records.provenance import code_commit


@dataclass(frozen=True, kw_only=True)
class TrialResult:
    """A finished trial."""

    trial: int
    """Number in the sweep, from 0."""
    configuration: int
    """Number of its configuration, from 0: trials of one differ in world and seed alone."""
    world: str
    """What was trained and shot in."""
    seed: int
    """Of the training."""
    parameters: dict[str, Any]
    """What is varied: name → value."""
    problem: str | None
    """Why it came to nothing; None if it did not."""
    hits: int
    """Shots that hit, over all cells."""
    shots: int
    """Decisions, over all cells; one that withholds its shot counts as a miss."""
    low: float | None
    """Lower end of the 95 % interval of the hit rate over all cells, 0 to 1; None where nothing was shot."""
    high: float | None
    """Upper end, 0 to 1."""
    mean_return: float | None
    """Mean return of an engagement at the end of the training [m]."""
    weights_sha256: str
    """Hash of the final weights; equal trainings have equal ones."""
    seconds: float
    """Wall time of training and shots, compilation included."""
    commit: str
    """Commit of the code that ran the sweep."""
    cells: tuple[CellHits, ...]
    """Hit rates by target and range."""

    @property
    def rate(self) -> float:
        """Hits per decision, 0 to 1; 0 for a trial that came to nothing, which is what it hits."""
        return self.hits / self.shots if self.shots else 0.0


def make_result(
    done: TrialDone, trial: int, configuration: int, world: str, seed: int, parameters: dict[str, Any]
) -> TrialResult:
    """Put together what is known of a finished trial, fields as in `TrialResult`."""
    overall = over_cells(done.cells)
    return TrialResult(
        trial=trial,
        configuration=configuration,
        world=world,
        seed=seed,
        parameters=parameters,
        problem=done.problem,
        hits=sum(cell.hits for cell in done.cells),
        shots=sum(cell.shots for cell in done.cells),
        low=None if overall is None else overall.low,
        high=None if overall is None else overall.high,
        mean_return=done.mean_return,
        weights_sha256=done.weights_sha256,
        seconds=round(done.seconds, 2),
        commit=code_commit(),
        cells=done.cells,
    )


def over_cells(cells: Sequence[CellHits]) -> Estimate | None:
    """Return hits per decision over all cells with an interval made from theirs; None without cells."""
    rates = [Estimate(cell.hits / cell.shots, cell.low, cell.high) for cell in cells]
    return weighted_mean(rates, [cell.shots for cell in cells])


def result_line(result: TrialResult) -> bytes:
    """Return the line of a trial in results.jsonl."""
    return json.dumps(asdict(result), allow_nan=False).encode() + b"\n"


def result_line_beginning() -> bytes:
    """Return what the line of every trial begins with."""
    return f'{{"{fields(TrialResult)[0].name}": '.encode()


def read_results(path: Path) -> list[TrialResult]:
    """Read results.jsonl, less a last line that a killed driver left unfinished.

    Raises:
      InputError: if another line is damaged, or a trial stands there twice.
    """
    content = path.read_bytes()[: whole_length(path)] if path.exists() else b""
    results: list[TrialResult] = []
    for number, line in enumerate(content.splitlines(), 1):
        try:
            result = from_json(TrialResult, json.loads(line))
        except (InputError, ValueError) as error:
            raise file_error(
                path, f"line {number} is not a trial ({error})", "begin a sweep in another folder"
            ) from error
        if any(each.trial == result.trial for each in results):
            raise file_error(path, f"line {number}: trial {result.trial} is there twice", "begin in another folder")
        results.append(result)
    return results


def whole_length(path: Path) -> int:
    """Return the bytes of results.jsonl up to the end of its last whole line."""
    return path.read_bytes().rfind(b"\n") + 1


def results_table(results: Iterable[TrialResult]) -> str:
    """Return results.csv: a row per trial in order, nothing of when and how fast, so equal sweeps give equal bytes."""
    ordered = sorted(results, key=lambda each: each.trial)
    names = list(dict.fromkeys(name for each in ordered for name in each.parameters))
    cells = list(dict.fromkeys((cell.target, cell.range_m) for each in ordered for cell in each.cells))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    head = ["trial", "configuration", "world", "seed", *names, "problem", *_counted("all"), "mean_return"]
    head += [column for cell in cells for column in _counted(_cell_name(*cell))]
    writer.writerow([*head, "weights_sha256"])
    for each in ordered:
        found = {(cell.target, cell.range_m): cell for cell in each.cells}
        row: list[Any] = [each.trial, each.configuration, each.world, each.seed]
        row += [each.parameters.get(name) for name in names]
        row += [each.problem or "", each.hits, each.shots, each.low, each.high, each.mean_return]
        for cell in cells:
            shot = found.get(cell)
            row += [shot.hits, shot.shots, shot.low, shot.high] if shot else [""] * 4
        writer.writerow([*("" if value is None else value for value in row), each.weights_sha256])
    return text.getvalue()


def _counted(name: str) -> list[str]:
    return [f"{name}_{each}" for each in ("hits", "shots", "low", "high")]


def _cell_name(target: str, range_m: tuple[float, float]) -> str:
    return f"{target}_{range_m[0]:g}_{range_m[1]:g}m"


def check_same(found: TrialResult, planned: TrialResult) -> None:
    """Refuse a finished trial that is not what the sweep would do now.

    Raises:
      InputError: naming what differs.
    """
    for name in ("configuration", "world", "seed", "parameters"):
        before, now = getattr(found, name), getattr(planned, name)
        if before != now:
            raise InputError(
                f"trial {found.trial} was done with {name} {before!r}, now it would be {now!r}; go on with the "
                "versions of Archerfish and Optuna that began the sweep, or begin in another folder"
            )
