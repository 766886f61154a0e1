"""Fields that colour the bodies in charts (displacement, temperature, stress, strain): values,
units, colours, and magnification of the deformation."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.model.facets import linear_surface, plane_triangles
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.results.result_variables import Derived, Field
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.style import plain, unit

MAPS: Mapping[Field, str] = {
    Quantity.DISPLACEMENT: "viridis", Quantity.TEMPERATURE: "YlOrRd", Derived.STRESS: "plasma",
    Derived.STRAIN: "cividis"}
"""Colour map of each field. Low temperatures are light, so that a thin hot layer is visible."""
NO_RUNS: Mapping[str, RunResult] = MappingProxyType({})
"""No runs in addition to the first."""


def drawn_steps(run: RunResult, times: Sequence[float] | None) -> IntArray:
    """Indices of the stored steps closest to `times` (s; default: one third, two thirds and the
    end)."""
    end = float(run.times[-1])
    return run.steps_at(times or (end / 3.0, 2.0 * end / 3.0, end))


def step_near(run: RunResult, time: float) -> int | None:
    """Index of the stored step of a run closest to a time, s; None if it stopped before."""
    end = float(run.times[-1]) if len(run.times) else -1.0
    return None if time > end * (1.0 + 1e-9) else int(np.argmin(np.abs(run.times - time)))


def step_title(run: RunResult, step: int, form: str) -> str:
    """Title of a panel: the name of the stored state (as of a mode), else its time; form: format of
    the time."""
    names = run.summary.get("states")
    if names:
        return plain(str(names[step]))
    clock = unit(float(run.times[-1]), "s")
    return f"t = {clock.factor * float(run.times[step]):{form}} {clock.name}"


def values_of(run: RunResult, body: str, step: int, quantity: Field) -> FloatArray | None:
    """The same as `nodal_values`; None for a body without the field."""
    return nodal_values(run, body, step, quantity) if run.has(body, quantity) else None


def nodal_values(run: RunResult, body: str, step: int, quantity: Field) -> FloatArray:
    """(P,) values at the points of `field_mesh`: displacement magnitude |u|, m, temperature, K, von
    Mises stress, Pa, or equivalent strain."""
    if isinstance(quantity, Derived):
        stress = quantity is Derived.STRESS
        return run.von_mises(body, step) if stress else run.equivalent_strain(body, step)
    if quantity is Quantity.TEMPERATURE:
        return run.nodal_temperature(body, step)
    return np.asarray(np.linalg.norm(run.nodal_displacement(body, step), axis=1))


def field_mesh(run: RunResult, body: str, quantity: Field) -> tuple[IntArray, IntArray, IntArray]:
    """Nodes (P,) of the points at which a field has values; triangles (T, 3) on them: of all cells
    of a plane body, of the surface of another one; and its outer segments or triangles (F, d).
    Stress and strain have several points at a node between materials, where they jump."""
    cells, d = run.cells(body), run.points(body).shape[1]
    nodes, own = np.arange(len(run.points(body))), cells
    if isinstance(quantity, Derived) and run.has(body, quantity):
        nodes, own = run.stress_mesh(body)
    outer = linear_surface(cells, d, own) if len(cells) else np.zeros((0, d), np.int64)
    return nodes, outer if d == 3 or not len(cells) else plane_triangles(own), outer


def scale_of(
    run: RunResult, bodies: Sequence[str], steps: Sequence[int], quantity: Field
) -> tuple[float, str]:
    """Factor from SI units to the unit of the colour bar, and its label."""
    if quantity is Quantity.TEMPERATURE:
        return 1.0, "temperature (K)"
    if quantity is Derived.STRAIN:
        return 1.0, "equivalent strain (1)"
    if quantity is Derived.STRESS:
        found = [values_of(run, b, s, quantity) for b in bodies for s in steps]
        shown = unit(max(float(v.max()) for v in found if v is not None), "Pa")
        return shown.factor, f"von Mises stress ({shown.name})"
    largest = max(float(np.abs(run.nodal_displacement(b, s)).max()) for b in bodies for s in steps)
    shown = unit(largest, "m")
    return shown.factor, f"displacement |u| ({shown.name})"


def shades(values: FloatArray, quantity: Field) -> tuple[float, float]:
    """Limits of the colour scale for these values; for displacements, stress and strain the lower
    limit is 0."""
    low = 0.0 if quantity is not Quantity.TEMPERATURE else float(values.min())
    high = float(values.max())
    # one colour throughout still needs a scale
    return (low, high) if low < high else (low - 0.5, high + 0.5)


def magnification(run: RunResult, bodies: Sequence[str], steps: Sequence[int]) -> float:
    """Magnification of displacements: 1, 2 or 5 times a power of ten such that the largest |u| is
    at most 6 % of the size of a body; at least 1."""
    ratio = 0.0
    for body in bodies:
        size = float(np.ptp(run.points(body), axis=0).max())
        for step in steps:
            u = np.linalg.norm(run.nodal_displacement(body, step), axis=1).max()
            ratio = max(ratio, float(u) / size)
    if ratio == 0.0 or ratio >= 0.06:
        return 1.0
    return float(round_below(0.06 / ratio))


def round_below(x: float) -> float:
    """Largest number of the form 1, 2 or 5 times a power of ten that does not exceed x > 0."""
    power = 10.0 ** np.floor(np.log10(x))
    return float(power * max(m for m in (1.0, 2.0, 5.0) if m * power <= x * (1.0 + 1e-12)))


def alike(reference: "RunResult", runs: "Mapping[str, RunResult]") -> "dict[str, RunResult]":
    """Runs whose fields can be drawn next to those of the reference: with the same bodies and
    meshes."""
    return {name: run for name, run in runs.items() if len(run.times) and all(
        body in run.bodies and run.points(body).shape == reference.points(body).shape
        for body in reference.bodies)}
