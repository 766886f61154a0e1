"""Verdict on one figure or table: its numbers, the rule that they meet, and its pictures."""

import sys
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sparsemor.core.analysis.charts.style import saved
from sparsemor.core.errors import InputError
from sparsemor.plugins.liang2026.measure import Results
from sparsemor.plugins.liang2026.paper import BROKEN, GRADES, MISSED, Item
from sparsemor.plugins.liang2026.rules import Operand, evaluate
from sparsemor.plugins.liang2026.sketches import numbers_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Number:
    """One row of an item's table: published and computed value."""

    name: str
    label: str
    unit: str
    paper: float | str | None
    here: Operand


@dataclass(frozen=True, slots=True)
class Verdict:
    """Outcome of one item. grade: `better`, `reproduced`, `in part`, `not reproduced` or `not
    computed`; rule: condition that was met, "" if none was; pictures: file names; faults: parts
    that could not be computed."""

    item: str
    grade: str
    rule: str
    numbers: tuple[Number, ...]
    pictures: tuple[str, ...]
    faults: tuple[str, ...] = ()

    @property
    def met(self) -> bool:
        """True for `better` and `reproduced`."""
        return self.grade in GRADES[:2]


def judged(item: Item, results: Results, pictures: Path) -> Verdict:
    """Verdict on an item, with its pictures drawn into a folder. Failures are part of the verdict,
    never raised."""
    known: dict[str, Operand] = {}
    faults = []
    for name, value in item.values.items():
        known[f"paper_{name}"] = value.paper
        try:
            known[name] = value.of.compute(results, known)
        except Exception as error:  # a fault in one number must not lose the others
            known[name] = None
            faults.append(f"{value.label}: {_reason(error)}")
    grade, rule = (BROKEN, "") if faults else _grade(item, known)
    numbers = tuple(Number(n, v.label, v.unit, v.paper, known[n]) for n, v in item.values.items())
    drawn, undrawn = _drawn(item, results, numbers, pictures)
    return Verdict(item.id, grade, rule, numbers, drawn, (*faults, *undrawn))


def _grade(item: Item, known: Mapping[str, Operand]) -> tuple[str, str]:
    for grade in GRADES:
        rule = next((r for g, r in item.verdict.items() if g == grade), None)
        if rule is not None and evaluate(rule, known):
            return grade, " ".join(rule.split())
    return MISSED, ""


def _drawn(
    item: Item, results: Results, numbers: tuple[Number, ...], folder: Path
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """File names of the pictures, and reasons why some could not be drawn."""
    files, faults = [], []
    for number, picture in enumerate(item.pictures, 1):
        try:
            for name, figure in picture.draw(results).items():
                if figure is not None:
                    files += _saved(figure, folder, f"{item.id}_{number}_{name}")
        except Exception as error:
            faults.append(f"picture {number}: {_reason(error)}")
    figure = numbers_figure(
        {n.label: (float(n.paper), float(n.here)) for n in numbers
         if isinstance(n.paper, int | float) and isinstance(n.here, int | float)
         and not isinstance(n.here, bool) and n.paper != n.here})
    if figure is not None:
        files += _saved(figure, folder, f"{item.id}_numbers")
    return tuple(files), tuple(faults)


def _saved(figure: "Figure", folder: Path, name: str) -> list[str]:
    folder.mkdir(parents=True, exist_ok=True)
    return [path.name for path in saved(figure, folder, name, ("png",))]


def _reason(error: Exception) -> str:
    if isinstance(error, InputError):
        return "; ".join(str(error).splitlines())
    traceback.print_exception(error, file=sys.stderr)
    return f"{type(error).__name__}: {error}"
