"""Analyses of a scene that are no run in time: `solve(scene, analysis)`."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core import FloatArray, InputError, Note, Quantity, Scene, State
from sparsemor.core.linalg.threads import fixed_threads
from sparsemor.core.registry.boundary import naming_plugins
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.results.output_lock import owned
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.progress import progress_bar
from sparsemor.plugins.analyses.analysed_model import (
    Prepared,
    equilibrium,
    prepare,
    steady_heat,
    time_of,
)
from sparsemor.plugins.analyses.buckling import buckling
from sparsemor.plugins.analyses.equilibrium import SolvedState, free_motions, neutral
from sparsemor.plugins.analyses.frequencies import frequencies
from sparsemor.plugins.analyses.frequency_response import (
    FrequencyResponse,
    frequency_response,
    kept_response,
)
from sparsemor.plugins.analyses.modes import ComplexArray
from sparsemor.plugins.analyses.stored_solution import (
    Solution,
    field_charts,
    quantities,
    scaled,
    stored,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sparsemor.plugins.kept_models.reduced_model import ReducedModel

SHAPE = 0.05
"""Largest motion of a stored mode relative to the size of its body."""
DRAWN = 6
"""Largest number of modes in a chart."""


@naming_plugins()
@fixed_threads()
@np.errstate(all="ignore")  # overflow ends in a status, not in a warning
def solve(
    scene: Scene, analysis: str, *, out: str | Path | None = None,
    observers: Sequence[object] = (), cache: Cache | None = None, progress: bool = False,
    **options: Any,
) -> Solution:
    """Solution of one analysis (`ANALYSES`) of a scene, at full order or in the trial spaces
    of its reducer.

    options: those of the analysis (docs/machines.md); out: directory for its states, table and
    charts, by default a temporary one for the states alone. Raises InputError for bad input,
    SolveFailed where there is no solution.
    """
    made = ANALYSES.get(analysis)
    if made is None:
        raise InputError(f"no analysis is called {analysis!r}: "
                         f"{suggestions(analysis, ANALYSES, 'analyses')}", "analysis")
    known = [n for n in signature(made).parameters if n not in ("p", "out")]
    if wrong := [n for n in options if n not in known]:
        near = suggestions(wrong[0], known, "options")
        raise InputError(f"{analysis} has no such option: {near}", wrong[0])
    folder = None if out is None else Path(out)
    with nullcontext() if folder is None else owned(folder), progress_bar(progress) as bar:
        found = made(prepare(scene, (*observers, *bar), cache), out=folder, **options)
        if folder is not None:
            found.write(folder)
    return found


def _static(
    p: Prepared, *, out: Path | None, at: float | None = None, spin: bool = False
) -> Solution:
    """Equilibrium under the loads at a time."""
    t = time_of(p.scene, at)
    solved = equilibrium(p, t, spin)
    notes = list(_left_out(p, spin))
    if not spin:
        notes += _held(p, solved.state)
    return _of_state(p, "static", solved, Quantity.DISPLACEMENT, notes, out)


def _steady_heat(p: Prepared, *, out: Path | None, at: float | None = None) -> Solution:
    """Steady temperatures."""
    return _of_state(p, "steady_heat", steady_heat(p, at=at), Quantity.TEMPERATURE, [], out)


def _of_state(
    p: Prepared, analysis: str, solved: SolvedState, shown: Quantity, notes: Sequence[Note],
    out: Path | None,
) -> Solution:
    """Solution of an analysis whose result is one state; shown: quantity of the chart."""
    state, name = p.system.state(solved.state), analysis.replace("_", " ")
    facts = {"t": state.t, "iterations": solved.iterations, "unknowns": p.system.layout.size}
    title = f"{name} at {state.t:g} s"
    made = Solution(analysis, p.scene.name, p.scene.reducer_name, (), tuple(notes), [title], facts)
    result = stored(p, [state], [state.t], made.stored_summary, out)
    return replace(made, rows=quantities(p, state, result, shown), result=result,
                   draw=lambda: field_charts(result, analysis, shown, [state.t]))


def _left_out(p: Prepared, spin: bool) -> list[Note]:
    """Warning about initial rates that an analysis at rest leaves out."""
    if spin or not p.model.v0[p.model.layout.second].any():
        return []
    return [Note("bodies of this scene move at the start, which an analysis at rest leaves out: "
                 "with the option spin they turn steadily", "rates_left_out")]


def _held(p: Prepared, s: State) -> list[Note]:
    """Note on free motions that stay at the pose of the start because nothing acts on them."""
    free = free_motions(p.system, s)
    if not free.shape[1]:
        return []
    still = neutral(p.system, s, free)
    if not still.shape[1]:
        return []
    names = dict.fromkeys(
        p.system.layout.containing(np.array([int(np.abs(n).argmax())]))[0].partition(".")[0]
        for n in still.T)
    return [Note(f"{still.shape[1]} rigid motion{'s' if still.shape[1] > 1 else ''} of "
                 f"{', '.join(names)} without force and stiffness: held at the pose of the start",
                 "held")]


def _frequencies(
    p: Prepared, *, out: Path | None, at: float | None = None, count: int = 10,
    spin: bool = False, about: str = "equilibrium",
) -> Solution:
    """Eigenfrequencies and modes about a state."""
    found = frequencies(p, at=at, count=count, spin=spin, about=about)
    modes, notes = found.modes, [*_left_out(p, spin), *found.notes]
    rows = [{"mode": i + 1, "frequency_hz": float(f), "damping_ratio": float(d),
             "real_per_s": float(v.real), "imaginary_per_s": float(v.imag), "rigid": bool(r)}
            for i, (f, d, v, r) in enumerate(zip(
                modes.frequencies, modes.ratios, modes.values, modes.rigid, strict=True))]
    names = ["state", *(f"mode {r['mode']}: {_in_words(r)}" for r in rows)]
    facts = {"t": found.state.t, "unknowns": p.system.layout.size}
    return of_shapes(p, "frequencies", found.state, found.changes, rows, names, facts, notes, out)


def _in_words(row: Mapping[str, Any]) -> str:
    """A mode in words: "rigid", its decay rate (1/s) or its frequency (Hz) and damping ratio."""
    if row["rigid"]:
        return "rigid"
    if row["imaginary_per_s"] == 0.0:
        return f"{row['real_per_s']:.4g} 1/s"
    ratio = row["damping_ratio"]
    return f"{row['frequency_hz']:.4g} Hz" + (f", ratio {ratio:.2g}" if abs(ratio) > 1e-9 else "")


def of_shapes(
    p: Prepared, analysis: str, state: State, changes: ComplexArray,
    rows: Sequence[Mapping[str, Any]], names: Sequence[str], facts: Mapping[str, Any],
    notes: Sequence[Note], out: Path | None,
) -> Solution:
    """Solution with a state and its changes (N, k) by modes, stored as states number 0, 1, ..., k
    at times of these numbers. The other arguments are the fields of `Solution`; names: of the
    states."""
    if not changes.shape[1]:
        changes = np.zeros((len(state.x), 0), complex)
    # phases of each mode such that its largest change is real
    turned = changes * np.exp(-1j * np.angle(np.take_along_axis(
        changes, np.abs(changes).argmax(axis=0)[None], axis=0)))
    shapes = scaled(turned, p, SHAPE)
    states = [state, *(replace(state, x=state.x + shape) for shape in shapes.T)]
    numbers = [float(i) for i in range(len(states))]
    made = Solution(
        analysis, p.scene.name, p.scene.reducer_name, rows, tuple(notes), names, facts)
    result = stored(p, states, numbers, made.stored_summary, out)

    def draw() -> "Mapping[str, Figure]":
        drawn = numbers[1 : DRAWN + 1]
        return field_charts(result, analysis, Quantity.DISPLACEMENT, drawn) if drawn else {}

    return replace(made, result=result, draw=draw)


def _buckling(
    p: Prepared, *, out: Path | None, at: float | None = None, count: int = 3,
    scaled: Sequence[str] | None = None,
) -> Solution:
    """Factors of loads at which the structure buckles."""
    found = buckling(p, at=at, count=count, scaled=scaled)
    rows = [{"mode": i + 1, "factor": float(f)} for i, f in enumerate(found.factors)]
    names = ["state", *(f"mode {r['mode']}: factor {r['factor']:.4g}" for r in rows)]
    facts = {"t": found.state.t, "unknowns": p.system.layout.size}
    return of_shapes(p, "buckling", found.state, found.changes.astype(complex), rows, names, facts,
                     found.notes, out)


def _frequency_response(
    p: Prepared, *, out: Path | None, input: str | None = None,
    frequencies: Sequence[float] | None = None, outputs: Sequence[str] | None = None,
    at: float | None = None, spin: bool = False, about: str = "equilibrium",
) -> Solution:
    """Steady response to one unit of a function of time, harmonic."""
    source, f = _harmonic(input, frequencies)
    notes = _left_out(p, spin)
    found = frequency_response(p, source, f, outputs, at, spin, about)
    return _of_response(found, source, p.scene, {"t": time_of(p.scene, at),
                                                 "unknowns": p.system.layout.size}, notes)


def _harmonic(
    source: str | None, frequencies: Sequence[float] | None
) -> tuple[str, FloatArray]:
    """Key of the function of time that is harmonic, and frequencies (f,), Hz. Raises InputError
    where one is missing or the frequencies do not increase."""
    if source is None:
        raise InputError("name the function of time that is harmonic, such as loads.push.factor",
                         "input")
    f = np.asarray([] if frequencies is None else frequencies, dtype=np.float64)
    if not (f.ndim == 1 and len(f) and np.isfinite(f).all() and (f >= 0.0).all()
            and (np.diff(f) > 0.0).all()):
        raise InputError("give increasing frequencies from 0 Hz on", "frequencies")
    return source, f


def _of_response(
    found: FrequencyResponse, source: str, scene: Scene, facts: Mapping[str, Any],
    notes: Sequence[Note],
) -> Solution:
    """Solution of a frequency response: rows and a chart, without states."""
    return Solution("frequency_response", scene.name, scene.reducer_name, found.rows(),
                    tuple(notes), (), {"input": source, "outputs": dict(found.units), **facts},
                    None, lambda: {"frequency_response": found.figure(source)})


def solve_kept(
    model: "ReducedModel", analysis: str, *, out: Path | None = None, input: str | None = None,
    frequencies: Sequence[float] | None = None, outputs: Sequence[str] | None = None,
) -> Solution:
    """Frequency response of a linear kept model. Raises InputError for other analyses, which need
    its scene."""
    if analysis != "frequency_response":
        raise InputError(f"{analysis} needs the scene of the model: a kept model has its "
                         "frequency_response", "analysis")
    source, f = _harmonic(input, frequencies)
    found = _of_response(kept_response(model, source, f, outputs), source, model.scene,
                         {"unknowns": model.size}, ())
    if out is not None:
        found.write(out)
    return found


ANALYSES: Mapping[str, Callable[..., Solution]] = {
    "static": _static, "steady_heat": _steady_heat, "frequencies": _frequencies,
    "buckling": _buckling, "frequency_response": _frequency_response}
"""Name of an analysis -> function of a prepared scene and its options."""
