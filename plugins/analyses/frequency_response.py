"""Steady response to a load or drive with a harmonic function of time.

With the tangents K, D, M about a state, in the axes of the bodies, and the force F that one unit of
the input exerts, the response to Re(a e^(i omega t)) is Re(z e^(i omega t)),

    (K + i omega D - omega^2 M) z = a F

for all unknowns together: displacements, rigid coordinates, joint forces and temperatures, of which
the equations of first order have D alone. F is the difference of the residuals with two values of
the input, of the part that it belongs to.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core import FloatArray, InputError, State
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.equations import system_residual
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.scene.option_tree import functions_of_time
from sparsemor.core.scene.overrides import split
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.controllers import sensors
from sparsemor.core.simulation.sensors_and_outputs import StepperOutput, read
from sparsemor.plugins.analyses.analysed_model import Prepared
from sparsemor.plugins.analyses.equilibrium import Solver
from sparsemor.plugins.analyses.frequencies import LinearisedSystem, linearised
from sparsemor.plugins.analyses.modes import ComplexArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sparsemor.plugins.kept_models.reduced_model import ReducedModel

SMALL = 1e-4
"""Largest change, relative to large motions, with which outputs are differentiated."""
DRAWN = 6
"""Largest number of outputs in a chart."""


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyResponse:
    """Amplitudes (f, o), complex, of outputs at frequencies (f,), Hz. units: name -> unit."""

    frequencies: FloatArray
    units: Mapping[str, str]
    values: ComplexArray

    def rows(self) -> list[dict[str, Any]]:
        """Frequency, and amplitude and phase of each output: the angle of its complex amplitude,
        degrees, below 0 where it lags behind the input."""
        found = []
        for f, row in zip(self.frequencies.tolist(), self.values, strict=True):
            line: dict[str, Any] = {"frequency_hz": f}
            for name, y in zip(self.units, row.tolist(), strict=True):
                line[name] = abs(y)
                line[f"{name} phase_deg"] = float(np.degrees(np.angle(y))) if y else 0.0
            found.append(line)
        return found

    def figure(self, source: str) -> "Figure":
        """Amplitudes and phases over frequency, of the outputs that respond."""
        from sparsemor.plugins.charts.style import (
            PAGE,
            draw_line,
            handles_of,
            legend_above,
            new_figure,
            tidy,
        )

        names = [n for n, column in zip(self.units, self.values.T, strict=True) if column.any()]
        figure = new_figure(0.7 * PAGE, 4.6)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
        for i, name in enumerate(names[:DRAWN]):
            y = self.values[:, [*self.units].index(name)]
            draw_line(above, self.frequencies, np.abs(y), i, f"{name} ({self.units[name]})")
            draw_line(below, self.frequencies, np.degrees(np.angle(y)), i)
        tidy(above, "", f"amplitude per unit of {source}")
        tidy(below, "frequency (Hz)", "phase (degrees)")
        if names:
            above.set_yscale("log")
            legend_above(figure, handles_of([above], [
                f"{n} ({self.units[n]})" for n in names[:DRAWN]]))
        if self.frequencies[0] > 0.0 and self.frequencies[-1] > 20.0 * self.frequencies[0]:
            above.set_xscale("log")
        below.set_yticks([-180, -90, 0, 90, 180])
        return figure


def frequency_response(
    p: Prepared, source: str, frequencies: FloatArray, outputs: Sequence[str] | None,
    at: float | None, spin: bool, about: str,
) -> FrequencyResponse:
    """Response of outputs to one unit of the function of time at the key `source` of the scene: at
    each frequency w, rad/s, the amplitude z of (K + i w D - w^2 M) z = T^T F in the unknowns of
    `linearised`, and the outputs' amplitudes for it. frequencies (f,): Hz. Raises InputError at the
    frequency of a mode without damping."""
    lin = linearised(p, at, spin, about)
    known = sensors(p.model, p.model.layout, {})
    names = _chosen(outputs, [n for n, o in known.items() if not o.rate], known)
    z = p.system.test(force(p, source, p.system.state(lin.state)))
    F, values = np.asarray(lin.axes[0].T @ z), []
    for f in frequencies.tolist():
        w = 2.0 * np.pi * f
        A = lin.z.K + 1j * w * lin.z.D - w * w * lin.z.M
        y = Solver(A, lin.state.t, f"the response at {f:g} Hz")(F.astype(complex))
        if not np.isfinite(y).all():
            raise InputError(f"the response at {f:g} Hz is not finite: a mode without damping has "
                             "this frequency", "frequencies")
        values.append(_amplitudes_of(p, lin, [known[n] for n in names],
                                     np.asarray(y, np.complex128), w))
    return FrequencyResponse(frequencies, {n: known[n].unit for n in names}, np.array(values))


def _chosen(
    wanted: Sequence[str] | None, usual: Sequence[str], known: Mapping[str, object]
) -> list[str]:
    """The wanted outputs, by default the usual ones. Raises InputError for names that are not
    known, and where there is none."""
    for name in wanted or ():
        if name not in known:
            raise InputError(f"no output is called {name!r}: {suggestions(name, known, 'outputs')}",
                             "outputs")
    names = list(usual if wanted is None else wanted)
    if not names:
        raise InputError("the scene has nothing to read: give it a probe", "outputs")
    return names


def force(p: Prepared, source: str, s: State) -> FloatArray:
    """Force (N,) on the model's unknowns of one unit of a function of time, in a state. Raises
    InputError for a key without such a function."""
    scene, (group, name, *_) = p.scene, (*map(str, split(source)), "", "")
    known = dict(functions_of_time({"loads": scene.loads, "joints": scene.joints}))
    if group not in ("loads", "joints") or name not in p.model.parts:
        raise InputError(f"no function of time is at {source!r}: "
                         f"{suggestions(source, known, 'inputs')}", "input")
    value = known[source].value(s.t) if source in known else 1.0

    def residual(number: float) -> FloatArray:
        changed: Scene = scene.using({source: number}, label="input")
        if source not in dict(functions_of_time({group: getattr(changed, group)})):
            raise InputError(f"{source} is no function of time: "
                             f"{suggestions(source, known, 'inputs')}", "input")
        model = assemble(changed, body_cache=p.bodies)
        return system_residual(model.layout, model.by_part[name], s.x, s.v, s.a, s.t)

    # loads are on the right-hand side: force = -(change of the residual by one unit)
    found = residual(value) - residual(value + 1.0)
    if not found.any():
        raise InputError(f"{source} acts on nothing that this scene solves for", "input")
    return found


def _amplitudes_of(
    p: Prepared, lin: LinearisedSystem, outputs: Sequence[StepperOutput], z: ComplexArray, w: float
) -> ComplexArray:
    """Complex amplitudes (o,) of outputs for an amplitude z (m,) of the unknowns at the angular
    frequency w, rad/s: their derivatives along the changes of positions and rates, real and
    imaginary part apart, by central differences. With T of `linearised` (axes: T, T', T''), dx = T
    z and dv = i w T z + T' z, as changes of the model's unknowns (direction); motion: their size
    relative to large motions."""
    system, state = p.system, p.system.state(lin.state)
    x = system.direction(np.asarray(lin.axes[0] @ z))
    v = system.direction(np.asarray(lin.axes[0] @ (1j * w * z) + lin.axes[1] @ z))
    found = np.zeros(len(outputs), complex)
    for factor, part in ((1.0, np.real), (1j, np.imag)):
        dx, dv = part(x), part(v)
        largest = system.motion(dx)
        e = SMALL / largest if largest > 0.0 else 1.0
        ahead, behind = (read(outputs, replace(
            state, x=state.x + k * dx, v=state.v + k * dv)) for k in (e, -e))
        found += factor * (ahead - behind) / (2.0 * e)
    return found


def kept_response(
    model: "ReducedModel", source: str, frequencies: FloatArray, outputs: Sequence[str] | None
) -> FrequencyResponse:
    """Response of a linear kept model to one unit of its input `source`, by its state space: C (i
    omega - A)^-1 B. frequencies (f,): Hz."""
    from sparsemor.plugins.export.matrices import state_space

    known = model.possible_inputs
    if source not in known:
        raise InputError(f"the model has no input {source!r}: "
                         f"{suggestions(source, known, 'inputs')}", "input")
    s = state_space(model, [source], outputs)
    one = np.eye(len(s.A))
    try:
        values = np.array([s.C @ np.linalg.solve(2j * np.pi * f * one - s.A, s.B[:, 0])
                           for f in frequencies.tolist()])
    except np.linalg.LinAlgError:
        raise InputError("a mode without damping has one of these frequencies",
                         "frequencies") from None
    units = model.stepper([source], s.outputs).outputs
    return FrequencyResponse(frequencies, dict(units), values)
