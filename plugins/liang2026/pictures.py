"""Pictures of a paper's figures and tables, drawn from our runs and studies."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from sparsemor.core.analysis.charts import (
    active_atoms_figure,
    angles_figure,
    contact_forces_figure,
    deformation_figure,
    error_over_time_figure,
    positions_figure,
    probe_displacement_figure,
    probe_temperature_figure,
    surface_figures,
)
from sparsemor.core.analysis.charts.time_histories import moving_bodies
from sparsemor.core.registry.plugin import Plugin
from sparsemor.core.results.error_norms import LIMIT
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.liang2026.measure import Results
from sparsemor.plugins.liang2026.sketches import flow_figure, geometry_figure
from sparsemor.plugins.liang2026.state_quantities import FIELDS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Figures = Mapping[str, "Figure | None"]


class Drawing(Plugin):
    """Base class of pictures: a frozen description that draws figures by name."""

    def runs(self) -> tuple[str, ...]:
        """Names of the runs that it draws."""
        return ()

    def studies(self) -> tuple[str, ...]:
        """Names of the studies that it draws."""
        return ()

    @abstractmethod
    def draw(self, results: Results) -> Figures:
        """Name -> figure, None where there are no data."""


class OverReference(Drawing):
    """Base class of pictures with a reference run and other runs."""

    reference: str
    """Run that is the reference."""
    others: dict[str, str] = {}
    """Label -> run."""
    label: str = "full order"
    """Label of the reference."""

    def runs(self) -> tuple[str, ...]:
        return (self.reference, *self.others.values())

    def opened(self, results: Results) -> dict[str, RunResult]:
        """Label -> result of the other runs."""
        return {label: results.run(name) for label, name in self.others.items()}


class Angles(OverReference):
    """Rotation angles over time."""

    draws: Literal["angles"]

    def draw(self, results: Results) -> Figures:
        return {"angles": angles_figure(
            results.run(self.reference), self.opened(results), self.label)}


class ErrorsOverTime(OverReference):
    """Errors of the other runs over time."""

    draws: Literal["errors"]

    def draw(self, results: Results) -> Figures:
        reference, others = results.run(self.reference), self.opened(results)
        measured = {label: results.errors(self.reference, name)
                    for label, name in self.others.items()}
        return {"errors": error_over_time_figure(
            measured, {name: run.status for name, run in others.items()},
            reference.layout.kinds, LIMIT)}


class Fields(OverReference):
    """Fields of the bodies at some times, of all runs next to each other."""

    draws: Literal["fields"]
    field: Literal["displacement", "temperature"]
    """Field that colours the bodies."""
    times: list[float]
    """Times, s."""
    bodies: list[str] = []
    """Bodies in space that are drawn; none for all. Planar bodies are drawn together."""

    def draw(self, results: Results) -> Figures:
        run, others = results.run(self.reference), self.opened(results)
        end = float(run.times[-1])
        times = [t for t in self.times if t <= end * (1.0 + 1e-9)] or [end]
        quantity = FIELDS[self.field]
        found: dict[str, Figure | None] = {self.field: deformation_figure(
            run, quantity, times, others, self.label)}
        return found | surface_figures(
            run, times, others=others, name=self.label,
            only=[(b, quantity) for b in self.bodies or run.bodies])


class Probes(OverReference):
    """Values of probes over time."""

    draws: Literal["probes"]
    field: Literal["displacement", "temperature"]
    """Field that is drawn."""

    def draw(self, results: Results) -> Figures:
        chart = (probe_temperature_figure if self.field == "temperature"
                 else probe_displacement_figure)
        return {self.field: chart(
            results.run(self.reference), self.opened(results), self.label)}


class Atoms(Drawing):
    """Active basis vectors (atoms) over time."""

    draws: Literal["atoms"]
    of: str
    """Run that is drawn."""
    label: str = "as published"
    """Label of the run."""

    def runs(self) -> tuple[str, ...]:
        return (self.of,)

    def draw(self, results: Results) -> Figures:
        return {"atoms": active_atoms_figure(results.run(self.of), self.label)}


class Forces(Drawing):
    """Contact forces over time."""

    draws: Literal["forces"]
    of: str
    """Run that is drawn."""

    def runs(self) -> tuple[str, ...]:
        return (self.of,)

    def draw(self, results: Results) -> Figures:
        return {"forces": contact_forces_figure(results.run(self.of).contacts())}


class Positions(Drawing):
    """Displacement of the body frames over time."""

    draws: Literal["positions"]
    of: str
    """Run that is drawn."""

    def runs(self) -> tuple[str, ...]:
        return (self.of,)

    def draw(self, results: Results) -> Figures:
        return {"positions": positions_figure(moving_bodies(results.run(self.of)))}


class Geometry(Drawing):
    """Meshes of the bodies at the start of a run, with joints' and loads' names."""

    draws: Literal["geometry"]
    of: str
    """Run that is drawn."""

    def runs(self) -> tuple[str, ...]:
        return (self.of,)

    def draw(self, results: Results) -> Figures:
        return {"geometry": geometry_figure(results.run(self.of))}


class Flow(Drawing):
    """Flow chart: steps from top to bottom, and an arrow back."""

    draws: Literal["flow"]
    steps: list[str] = Field(min_length=2)
    """Texts of the boxes."""
    back: tuple[int, int] | None = None
    """Number of the step from which, and to which, the arrow back leads (the first is 1)."""
    again: str = ""
    """Text at the arrow back."""

    def draw(self, results: Results) -> Figures:
        return {"flow": flow_figure(self.steps, self.back, self.again)}


Picture = Annotated[
    Angles | ErrorsOverTime | Fields | Probes | Atoms | Forces | Positions | Geometry | Flow,
    Field(discriminator="draws")]
"""A picture of a paper file: `{draws: angles, reference: a, others: {label: b}}`."""
