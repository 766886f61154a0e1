"""Plausibility checks: warnings about admissible inputs that are almost surely mistakes, each with
the number that shows it.

`before_run` checks the scene and its assembled model, `of_solver` the reduced model, `after_run`
the stored results. Bodies, joints, contacts and loads report their own notes
(`protocols.HasNotes`).
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from pydantic import BaseModel

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols import (
    HasNotes,
    LimitsTemperature,
    Part,
    StepSolver,
    TimeFunction,
    UsesBases,
)
from sparsemor.core.protocols.layout import Quantity
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.nested import functions_of_time as time_functions
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.diagnostics.mixed_scales import mixed_scales
from sparsemor.core.simulation.diagnostics.unheld_bodies import unheld_bodies
from sparsemor.core.simulation.memory.estimate import trains
from sparsemor.core.simulation.offline import step_count
from sparsemor.core.simulation.run_header import shapes

OUTSIDE = 1e-2
"""Distance of a point from a body's bounding box, relative to the box's diagonal, above which there
is a warning."""
HOTTEST = 1e4
"""Temperature, K, above which there is a warning: no solid is that hot, tungsten melts at 3 695
K."""
COLDEST = 50.0
"""Initial temperature, K, above which temperatures are taken as absolute. Temperatures that start
at 0 are changes, for which the discretisation may undershoot 0."""
SHORT = 0.5
"""Share of the run that a training run should cover at least."""
TURNS = 0.55
"""Changes of direction per step, of a function of time, above which there is a warning; 0.5 are 4
steps per period."""
SAMPLES = 12
"""Number of samples of a function of time per step."""
WINDOW, WINDOWS = 50, 10
"""Consecutive steps over which a function of time is sampled, and the number of such windows."""
STEPS = 10**6
"""Largest number of steps for which a function of time is evaluated at every step."""
ROUND = 1e-6
"""Temperature difference, K, by which a property's range may be exceeded without a warning."""
STORED, LARGE = 8, 20_000
"""Number of stored steps at which a block is checked, and number of unknowns above which only the
last one is."""


def before_run(scene: Scene, model: Model) -> tuple[Note, ...]:
    """Warnings that need no time step: parts, probes, temperatures, functions of time, training
    run."""
    parts = [n for part in model.parts.values() if isinstance(part, HasNotes) for n in part.notes]
    return (*scene.notes, *parts, *unheld_bodies(scene, model), *mixed_scales(model),
            *distant_probes(scene, model), *start_temperatures(model),
            *prescribed_temperatures(scene, model), *of_settings(scene, model))


OUTSIDE_RANGE = "outside_parameters"
SETTINGS = frozenset({"never_acts", "too_fast", "short_training", OUTSIDE_RANGE})
"""Identifiers of warnings about options that a run of a kept model may change."""


def of_settings(scene: Scene, model: Model | None) -> tuple[Note, ...]:
    """Warnings about functions of time, parameters and, where the model is at hand, the training
    run."""
    return (*functions_of_time(scene), *outside_ranges(scene),
            *(() if model is None else short_training(scene, model)))


def of_solver(scene: Scene, solver: StepSolver) -> tuple[Note, ...]:
    """Warnings about blocks that are reduced to one atom (basis vector) although more exist;
    information on those that have fewer atoms than the options ask for."""
    found = []
    for name, d in solver.dictionaries.items():
        rank = d.info.get("numerical_rank", d.info.get("rank_at_least", 2))
        if d.atoms.shape[1] == 1 and isinstance(rank, int) and rank > 1:
            found.append(Note(
                f"{name} is reduced to 1 atom for {len(d.offset)} unknowns: it can only grow and "
                "shrink in one shape; take more atoms", "one_atom"))
        have, asked = d.atoms.shape[1], _asked(scene, name)
        if 0 < have < asked:
            found.append(information(
                f"{name}: {asked} atoms are asked for, and {have} exist"
                + (f", one for each of its {len(d.offset)} unknowns" if have == len(d.offset) else
                   "; a basis has no more than its snapshots or modes span"), "fewer_atoms"))
    return tuple(found)


def _asked(scene: Scene, block: str) -> int:
    """Number of atoms that the options of a reducer and of its basis ask for in a block, 0 if they
    do not limit it."""
    reducer: object = scene.reducer
    if not isinstance(reducer, UsesBases):
        return 0
    count = getattr(matched_option(block, reducer.bases, reducer.basis), "count", None)
    budget = matched_option(block, getattr(reducer, "budgets", {}), None)
    limits = (count, getattr(budget, "atoms", None))
    return max((n for n in limits if isinstance(n, int)), default=0)


def after_run(model: Model, result: RunResult) -> tuple[Note, ...]:
    """Warnings about results outside the validity of the equations: temperatures that no solid has,
    displacements larger than the body's smallest extent."""
    found: list[Note] = []
    nonlinear = {m.name for m in model.separated.moving if m.operators is not None and (
        s := m.operators.stress_stiffness) is not None and s.nonlinear}
    for name, shape in shapes(model).items():
        heated, moved = (result.layout.of(name, q) for q in (
            Quantity.TEMPERATURE, Quantity.DISPLACEMENT))
        if heated is not None:
            T = result.block(heated.name, checked_steps(result, heated.name))
            absolute = bool((np.abs(model.x0[model.layout[heated.name]]) > COLDEST).any())
            found += temperature_notes(f"temperatures of {name}", T, 0.0 if absolute else 1.0)
            found += property_notes(model.parts[name], T)
        if moved is not None:
            largest = max(float(np.linalg.norm(result.nodal_displacement(name, int(i)), axis=1)
                                .max()) for i in checked_steps(result, moved.name))
            extent = float(np.ptp(shape.points, axis=0).min())
            if largest > extent and name not in nonlinear:
                found.append(Note(
                    f"displacements of {name} reach {largest:.3g} m, {largest / extent:.2g} times "
                    f"its smallest extent of {extent:.3g} m: linear elasticity does not hold "
                    f"there; take bodies.{name}.strains: nonlinear, or check E, the thickness and "
                    "the loads", "large_displacement"))
    return tuple(found)


def property_notes(body: Part, T: FloatArray) -> Iterator[Note]:
    """Warnings about temperatures T (K) outside the range in which a material property of the body
    is defined."""
    limits = body.temperature_limits if isinstance(body, LimitsTemperature) else {}
    values = T[np.isfinite(T)]
    for key, (low, high) in limits.items() if values.size else ():
        coldest, hottest = float(values.min()), float(values.max())
        worst = hottest if hottest - high > low - coldest else coldest
        if coldest < low - ROUND or hottest > high + ROUND:
            yield Note(f"bodies.{body.name}.{key} is defined from {low:g} to {high:g} K, and "
                       f"temperatures of {body.name} reach {worst:.5g} K: it is constant outside",
                       "property_range")


def distant_probes(scene: Scene, model: Model) -> Iterator[Note]:
    """Warnings about probes outside their body: the nearest node is recorded instead."""
    for name, shape in shapes(model).items():
        for key, probe in scene.probes.items():
            if probe.body == name and not isinstance(probe.at, str):
                yield from outside_box_notes(f"probes.{key}", probe.at, shape.points)


def outside_box_notes(key: str, point: Sequence[float], points: FloatArray) -> Iterator[Note]:
    """Warning if a point (d,) is outside the bounding box of points (N, d), m; key: name of the
    point in the scene."""
    at, low, high = np.asarray(point, dtype=np.float64), points.min(axis=0), points.max(axis=0)
    away = float(np.linalg.norm(at - np.clip(at, low, high)))
    size = float(np.linalg.norm(high - low))
    if away > OUTSIDE * size:
        nearest = points[np.argmin(np.linalg.norm(points - at, axis=1))]
        yield Note(f"{key} at {_point(at)} is {away:.3g} m outside its body, whose diagonal is "
                   f"{size:.3g} m: the nearest node at {_point(nearest)} is taken", "distant_point")


def start_temperatures(model: Model) -> Iterator[Note]:
    """Warnings about initial temperatures that no solid has."""
    for block in model.layout:
        if block.kind.quantity is Quantity.TEMPERATURE:
            yield from temperature_notes(
                f"initial temperatures of {block.owner}", model.x0[model.layout[block.name]])


def prescribed_temperatures(scene: Scene, model: Model) -> Iterator[Note]:
    """Warnings about prescribed temperatures that no solid has, at up to a thousand times of the
    run."""
    times = np.linspace(0.0, scene.time.end, min(step_count(scene), 1000) + 1)
    for name, shape in shapes(model).items():
        if shape.given:
            yield from temperature_notes(f"prescribed temperatures of {name}",
                                         shape.given_at(times))


def temperature_notes(what: str, T: FloatArray, undershoot: float = 0.0) -> list[Note]:
    """Warnings about temperatures T (K) below 0 by more than the share `undershoot` of the highest
    one, or above `HOTTEST`; what: their name in the text."""
    values = T[np.isfinite(T)]
    if not values.size:
        return []
    low, high, found = float(values.min()), float(values.max()), list[Note]()
    if low < min(-undershoot * high, 0.0):
        found.append(Note(f"{what} are in K and fall to {low:.4g} K, below absolute zero",
                          "impossible_temperature"))
    if high > HOTTEST:
        found.append(Note(f"{what} reach {high:.3g} K: no solid is that hot (above {HOTTEST:g} K); "
                          "check the heat, the thickness and the material",
                          "impossible_temperature"))
    return found


def short_training(scene: Scene, model: Model) -> Iterator[Note]:
    """Warning about a training run that covers less than half of the run."""
    share = scene.training_end / scene.time.end
    blocks = {n: 0 for n in model.reducible()}
    if share < SHORT and trains(scene, blocks, model):
        yield Note(
            f"the training run ends at {scene.training_end:g} s, {100.0 * share:.3g} % of "
            f"time.end = {scene.time.end:g} s: what happens later was never in the snapshots; "
            "raise training.end", "short_training")


def outside_ranges(scene: Scene) -> Iterator[Note]:
    """Warnings of a reduced run about parameters outside the range that the scene declares."""
    if isinstance(scene.reducer, UsesBases):
        for name, value in scene.outside_ranges.items():
            yield Note(f"parameter {name} is {value:g}, outside its range "
                       f"{scene.parameters[name].range}: the reduced model was made for this "
                       "range, and its error may be large", OUTSIDE_RANGE)


# ---------------------------------------------------------------------- functions of time

def functions_of_time(scene: Scene) -> Iterator[Note]:
    """Warnings about functions of time that are 0 at all steps, or change faster than the steps
    resolve."""
    count, h = step_count(scene), scene.time.step
    for group in ({"joints": scene.joints}, {"contacts": scene.contacts}, {"loads": scene.loads}):
        for key, function in time_functions(group):
            note = _never_acts(key, function, count, h)
            if note is None and not scene.time.control:
                note = _too_fast(key, function, count, h)
            if note is not None:
                yield note


def _numbers_in(function: TimeFunction) -> Iterator[float]:
    """Nonnegative numbers in a function's options: the times of its changes are among them. Those
    of the terms of a sum are not: the terms are checked on their own."""
    pending: list[object] = [dict(function)] if isinstance(function, BaseModel) else []
    while pending:
        value = pending.pop()
        if isinstance(value, int | float) and np.isfinite(value) and value >= 0.0:
            yield float(value)
        elif isinstance(value, Mapping):
            pending += value.values()
        elif isinstance(value, list | tuple):
            pending += value


def _never_acts(key: str, function: TimeFunction, count: int, h: float) -> Note | None:
    """Warning about a function that is 0 at all `count` steps of h (s), but not in between or
    later."""
    if count > STEPS:
        return None
    end = count * h
    between = [h * (i + f) for i in range(min(count, 100)) for f in (0.29, 0.5, 0.71)]
    later = list(end * np.geomspace(1.0, 1e3, 30))
    times = [*_numbers_in(function), *between, *later]
    values = np.abs([function.value(float(t)) for t in times])
    peak = float(values.max())
    small = 1e-9 * peak
    if peak == 0.0 or any(abs(function.value(n * h)) > small for n in range(1, count + 1)):
        return None
    at = times[int(values.argmax())]
    where = (f"which is after time.end = {end:g} s: let it begin earlier" if at > end else
             f"between two steps of {h:g} s: take a smaller time.step")
    return Note(f"{key} is 0 at all {count} steps and never acts; it reaches {peak:.4g} at "
                f"{at:g} s, {where}", "never_acts")


def _too_fast(key: str, function: TimeFunction, count: int, h: float) -> Note | None:
    """Warning about a function with fewer than 4 steps of h (s) per period."""
    spread = np.sort(np.mod(0.5 + 0.6180339887498949 * np.arange(SAMPLES), 1.0))
    extremes, steps = 0, 0
    first = {0} if count <= WINDOW * WINDOWS else {
        int(i) for i in np.linspace(0, count - WINDOW, WINDOWS)}
    for i in sorted(first):
        n = min(count, WINDOW * WINDOWS) if len(first) == 1 else WINDOW
        t = h * (i + np.arange(n)[:, None] + spread).ravel()
        change = np.diff([function.value(float(s)) for s in t])
        change = change[np.abs(change) > 1e-9 * np.abs(change).max(initial=0.0)]
        extremes += int(np.count_nonzero(change[1:] * change[:-1] < 0.0))
        steps += n
    if extremes < 4 or extremes <= TURNS * steps:
        return None
    period = 2.0 * steps / extremes
    return Note(f"{key} changes direction {extremes} times in {steps} steps, {period:.2g} steps "
                f"per period: take time.step of at most {h * period / 20.0:.2g} s (20 per period)",
                "too_fast")


def checked_steps(result: RunResult, name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """Stored steps at which a block is checked; for a reduced block those of the largest
    coefficients and the last."""
    last = len(result.times) - 1
    if result.reduced(name):
        size = np.linalg.norm(result.coefficients(name), axis=1)
        return np.unique([int(np.nan_to_num(size).argmax()), last])
    large = next(b.size for b in result.layout if b.name == name) > LARGE
    return np.unique(np.linspace(last if large else 0, last, STORED).astype(np.int64))


def _point(p: FloatArray) -> str:
    return "(" + ", ".join(f"{c:.6g}" for c in p) + ")"
