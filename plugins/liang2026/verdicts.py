"""Verdict on one figure or table: its numbers, the rule that they meet, and its pictures."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sparsemor.plugins.charts.style import saved
from sparsemor.plugins.liang2026.item_functions import Results, Value, reason_of
from sparsemor.plugins.liang2026.paper import BROKEN, GRADES, PaperItem
from sparsemor.plugins.liang2026.pictures import numbers_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Number:
    """One row of an item's table: published and computed value."""

    name: str
    label: str
    unit: str
    paper: float | str | None
    here: Value


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


def judged(item: PaperItem, results: Results, folder: Path) -> Verdict:
    """Verdict on an item, with its pictures drawn into a folder. Failures are part of the verdict,
    never raised. Its rule, and later values, may use the values by name, and the published ones as
    `paper_NAME`."""
    known: dict[str, Value] = {}
    faults = []
    drawn: dict[str, Figure | None] = {}
    for name, value in item.values.items():
        known[f"paper_{name}"] = value.paper
        try:
            known[name] = value.of.made(results, known)
        except Exception as error:  # a fault in one number must not lose the others
            known[name] = None
            faults.append(f"{value.label}: {reason_of(error)}")
    grade = BROKEN if faults else item.grade(known)
    numbers = tuple(Number(n, v.label, v.unit, v.paper, known[n]) for n, v in item.values.items())
    for number, picture in enumerate(item.pictures, 1):
        try:
            drawn |= {f"{item.id}_{number}_{name}": figure
                      for name, figure in picture.made(results, known).items()}
        except Exception as error:  # named, but the grade is that of the numbers
            faults.append(f"picture {number}: {reason_of(error)}")
    drawn[f"{item.id}_numbers"] = numbers_figure({
        n.label: (n.paper, n.here) for n in numbers if n.paper != n.here
        and isinstance(n.paper, int | float) and isinstance(n.here, int | float)
        and not isinstance(n.here, bool)})
    folder.mkdir(parents=True, exist_ok=True)
    files = [path.name for name, figure in drawn.items() if figure is not None
             for path in saved(figure, folder, name, ("png",))]
    met = next((rule for g, rule in item.verdict.items() if g == grade), "")
    return Verdict(
        item.id, grade, " ".join(met.split()), numbers, tuple(files), tuple(faults))
