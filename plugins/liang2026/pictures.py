"""The pictures that an item of a paper file may name: `{draws: angles, reference: a, others:
{label: b}}`. Each is drawn from our runs, as figures by name, None where there are no data."""

from collections.abc import Mapping
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, TypeAlias

from pydantic import Field

from sparsemor.core.results.error_norms import LIMIT
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins import charts
from sparsemor.plugins.charts.time_histories import moving_bodies
from sparsemor.plugins.liang2026.parts import PaperPart, errors_of, part_of
from sparsemor.plugins.liang2026.quantities import FIELDS, FieldName
from sparsemor.plugins.liang2026.sketches import flow_figure, geometry_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure
else:
    Figure = object

Figures: TypeAlias = Mapping[str, Figure | None]
Others: TypeAlias = Mapping[str, RunResult]
"""Label -> run."""
NONE: Others = {}


def angles(reference: RunResult, others: Others = NONE, label: str = "full order") -> Figures:
    """Rotation angles over time; label: of the reference."""
    return {"angles": charts.angles_figure(reference, others, label)}


def errors(reference: RunResult, others: Others = NONE, label: str = "full order") -> Figures:
    """Errors of the other runs over time."""
    return {"errors": charts.error_over_time_figure(
        {name: errors_of(reference, run) for name, run in others.items()},
        {name: run.status for name, run in others.items()}, reference.layout.kinds, LIMIT)}


def fields(
    reference: RunResult, field: FieldName, times: list[float], others: Others = NONE,
    label: str = "full order", bodies: list[str] = [],  # noqa: B006 (never changed)
) -> Figures:
    """A field of the bodies at some times, of all runs next to each other; bodies: those in space
    that are drawn, none for all. Planar bodies are drawn together."""
    end, quantity = float(reference.times[-1]), FIELDS[field]
    within = [t for t in times if t <= end * (1.0 + 1e-9)] or [end]
    return {field: charts.deformation_figure(reference, quantity, within, others, label),
            **charts.surface_figures(reference, within, others=others, name=label, only=[
                (b, quantity) for b in bodies or reference.bodies])}


def probes(
    reference: RunResult, field: FieldName, others: Others = NONE, label: str = "full order"
) -> Figures:
    """Values of probes over time."""
    chart = (charts.probe_temperature_figure if field == "temperature"
             else charts.probe_displacement_figure)
    return {field: chart(reference, others, label)}


def atoms(of: RunResult, label: str = "as published") -> Figures:
    """Active basis vectors (atoms) over time."""
    return {"atoms": charts.active_atoms_figure(of, label)}


def forces(of: RunResult) -> Figures:
    """Contact forces over time."""
    return {"forces": charts.contact_forces_figure(of.contacts())}


def positions(of: RunResult) -> Figures:
    """Displacement of the body frames over time."""
    return {"positions": charts.positions_figure(moving_bodies(of))}


def geometry(of: RunResult) -> Figures:
    """Meshes of the bodies at the start of a run, with joints' and loads' names."""
    return {"geometry": geometry_figure(of)}


def flow(
    steps: list[str], back: tuple[int, int] | None = None, again: str = ""
) -> Figures:
    """Flow chart: steps from top to bottom, and an arrow back from one step to another (the first
    is 1) with the text `again`."""
    return {"flow": flow_figure(steps, back, again)}


if TYPE_CHECKING:
    Picture: TypeAlias = PaperPart
else:
    Picture = Annotated[reduce(or_, (part_of(f, "draws") for f in (
        angles, errors, fields, probes, atoms, forces, positions, geometry, flow))),
        Field(discriminator="draws")]
