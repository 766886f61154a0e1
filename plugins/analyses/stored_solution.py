"""Solution of an analysis: its states as a stored result, its table, and its chart.

The states are stored at full order as those of a run, so that `export`, `pictures` and the option
`initial` of a scene read them. They are no motion: their names are in the summary (`states`), and
their times are those of a static state, or the numbers of modes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core import FloatArray, Note, Quantity, RunResult, State, Status
from sparsemor.core.notes import Level, sentences
from sparsemor.core.results.atomic_files import writing
from sparsemor.core.results.files.replaceable_files import STORE
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.results.probes import ForceReader, ProbeReader
from sparsemor.core.results.result_variables import Derived
from sparsemor.core.results.result_writer import ChunkOfSteps, ResultWriter
from sparsemor.core.simulation.controllers import sensors
from sparsemor.core.simulation.sensors_and_outputs import read
from sparsemor.core.simulation.stages_before_steps import full_order_header
from sparsemor.plugins.analyses.analysed_model import Prepared
from sparsemor.plugins.analyses.modes import ComplexArray
from sparsemor.plugins.publishing.listed_files import publishing
from sparsemor.plugins.publishing.tables import csv_table, text_table, with_head

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure

SHOWN = 40
"""Largest number of rows of a table that is printed."""
FORMATS = ("png", "svg")


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Solution of one analysis of a scene.

    rows: its table, one mapping of columns each; states: names of the states of `result`, which is
    None where the analysis has none; facts: further entries of its summary; draw: its charts, name
    of the file -> figure.
    """

    analysis: str
    scene: str
    reducer: str
    rows: Sequence[Mapping[str, Any]]
    notes: tuple[Note, ...]
    states: Sequence[str] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
    result: RunResult | None = None
    draw: "Callable[[], Mapping[str, Figure]]" = dict

    def __str__(self) -> str:
        rows = with_head(self.rows[:SHOWN])
        table = text_table([[_shown(v) for v in row] for row in rows]) if self.rows else "no rows"
        more = len(self.rows) - SHOWN
        return table + (f"\nand {more} more" if more > 0 else "")

    def column(self, name: str) -> list[Any]:
        """One column of the table."""
        return [row[name] for row in self.rows]

    @property
    def stored_summary(self) -> dict[str, Any]:
        """Summary that is stored with the states."""
        return {
            "status": Status.DONE.value, "analysis": self.analysis, "scene": self.scene,
            "reducer": self.reducer, **self.facts, "states": list(self.states),
            "notes": sentences(self.notes, Level.WARNING),
            "information": sentences(self.notes, Level.INFORMATION)}

    @property
    def summary(self) -> dict[str, Any]:
        """Summary as plain data, with the whole table."""
        return self.stored_summary | {"table": [dict(row) for row in self.rows]}

    def write(self, folder: Path) -> list[Path]:
        """Writes the table ANALYSIS.csv and the charts into a folder; returns their paths."""
        from sparsemor.plugins.charts.style import save

        with writing(folder), publishing(folder, "analysis") as fresh:
            table = fresh / f"{self.analysis}.csv"
            table.write_text(csv_table(with_head(self.rows)), encoding="utf-8", newline="")
            names = [table.name]
            for name, figure in self.draw().items():
                names += [f.name for f in save(figure, fresh, name, FORMATS)]
        return [folder / name for name in names]


def _shown(value: object) -> str:
    """Entry of a printed table: numbers with 6 digits, "yes" or "" of a flag, "" of None."""
    if isinstance(value, bool):
        return "yes" if value else ""
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)


def stored(
    p: Prepared, states: Sequence[State], times: Sequence[float], summary: Mapping[str, Any],
    out: Path | None,
) -> RunResult:
    """States of the model as a result in `out`, or in a temporary folder; times: under which they
    are stored. summary: with their names as `states`."""
    temporary = TemporaryFolder() if out is None else None
    folder = Path(out or "") if temporary is None else temporary.path
    if temporary is None:
        OutputDirectory(folder).require_writable()
    header = full_order_header(p.scene, p.model, len(states))
    writer = ResultWriter.create(folder / STORE, header)
    X, t = np.array([s.x for s in states]), np.array([s.t for s in states])
    V, layout = np.array([s.v for s in states]), p.model.layout
    probes = [ProbeReader.at_place(place, layout, {}) for place in p.model.probes]
    forces = [ForceReader.from_force(n, j.force, layout) for n, j in p.model.joints.items()
              if j.force is not None]
    zero = np.zeros(len(t))
    # a force element needs the rates of its two poses too, by their first unknown
    writer.append(ChunkOfSteps(
        np.array(times, float), X, np.zeros(len(t), np.int64), zero, zero,
        probes={r.name: r(t, X) for r in probes},
        forces={f.name: f(t, X, {e.start: V[:, e] for e in f.ends if isinstance(e, slice)})
                for f in forces},
        given={n: s.given_at(t) for n, s in p.model.shapes().items() if s.given}))
    writer.finish(Status.DONE, summary)
    result = writer.result()
    return result if temporary is None else result.held_in(temporary)


def quantities(
    p: Prepared, s: State, result: RunResult, shown: Quantity
) -> list[dict[str, Any]]:
    """Table of a single state: the largest values of each body's fields, probes, and joint forces
    and rigid coordinates; of temperatures (`shown`) these alone."""
    heat = shown is Quantity.TEMPERATURE
    rows: list[dict[str, Any]] = []

    def add(name: str, value: float, unit: str) -> None:
        rows.append({"quantity": name, "value": float(value), "unit": unit})

    for body in result.bodies:
        if result.has(body, Quantity.DISPLACEMENT) and not heat:
            u = np.linalg.norm(result.nodal_displacement(body, 0), axis=1)
            add(f"{body}: largest |u|", u.max(), "m")
            if result.has(body, Derived.STRESS):
                add(f"{body}: largest von Mises stress", result.von_mises(body, 0).max(), "Pa")
        if result.has(body, Quantity.TEMPERATURE):
            T = result.nodal_temperature(body, 0)
            add(f"{body}: lowest temperature", T.min(), "K")
            add(f"{body}: highest temperature", T.max(), "K")
    outputs = {n: o for n, o in sensors(p.model, p.model.layout, {}).items()
               if not o.rate and (o.unit == "K" or not heat)}
    values = read([*outputs.values()], s) if outputs else np.zeros(0)
    for (name, output), value in zip(outputs.items(), values, strict=True):
        add(name, float(value), output.unit)
    return rows


def field_charts(
    result: RunResult, name: str, quantity: Any, times: Sequence[float]
) -> "dict[str, Figure]":
    """Charts of a field of all bodies at some states, one of all plane bodies and one of each body
    in space."""
    from sparsemor.plugins.charts.planar_fields import deformation_figure
    from sparsemor.plugins.charts.surface_fields import surface_figures

    found: dict[str, Figure] = {}
    if (plane := deformation_figure(result, quantity, times)) is not None:
        found[name] = plane
    for key, figure in surface_figures(result, times, fields=[quantity]).items():
        found[f"{name}_{key.partition('_')[2]}"] = figure
    return found


def scaled(changes: ComplexArray, p: Prepared, share: float) -> FloatArray:
    """Changes (N, k) of the model's unknowns with the largest real motion of each column `share` of
    the size of its body."""
    size = p.system.sizes()
    some = size > 0.0
    largest = np.abs(changes.real[some] / size[some, None]).max(axis=0)
    return np.asarray(changes.real * (share / np.where(largest > 0.0, largest, 1.0)))
