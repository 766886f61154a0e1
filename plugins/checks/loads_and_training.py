"""Functions of time that never act, change too fast or do not vary in training, short training
runs, parameters outside their range, and blocks that are reduced to fewer atoms than there could
be, or were asked for."""

from collections.abc import Iterator, Mapping

import numpy as np
from pydantic import BaseModel

from sparsemor.core import (
    Check,
    Findings,
    Model,
    Note,
    PreparedRun,
    Scene,
    StepSolver,
    TimeFunction,
    information,
    step_count,
)
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.core.scene.option_tree import functions_of_time
from sparsemor.core.simulation.memory.estimate import trains
from sparsemor.plugins.checks import place

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
OUTSIDE_RANGE = "outside_parameters"


class Options(Check):
    """Functions of time, training runs and parameters that are almost surely a mistake."""

    order = place("options")
    renewed = frozenset({"never_acts", "too_fast", "short_training", OUTSIDE_RANGE})

    def on_model(self, scene: Scene, model: Model | None) -> tuple[Note, ...]:
        return (*unresolved_functions(scene), *outside_ranges(scene), *unvaried_loads(scene),
                *(() if model is None else short_training(scene, model)))


def unresolved_functions(scene: Scene) -> Iterator[Note]:
    """Warnings about functions of time that are 0 at all steps, or change faster than the steps
    resolve."""
    count, h = step_count(scene), scene.time.step
    for group in ({"joints": scene.joints}, {"contacts": scene.contacts}, {"loads": scene.loads}):
        for key, function in functions_of_time(group):
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
    times = [*_numbers_in(function), *between, *later]  # where it may differ from 0
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
    """Warning about a function with fewer than 4 steps of h (s) per period, in which it changes
    direction twice. count: number of steps of the run; if they are many, some windows of them are
    looked at."""
    # samples in each step at multiples of the golden ratio, which keep step with no period
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
    if not scene.reducer.full_order:
        for name, value in scene.outside_ranges.items():
            yield Note(f"parameter {name} is {value:g}, outside its range "
                       f"{scene.parameters[name].range}: the reduced model was made for this "
                       "range, and its error may be large", OUTSIDE_RANGE)


def unvaried_loads(scene: Scene) -> Iterator[Note]:
    """Warnings of a reduced run about loads that may vary and do not in its training runs."""
    if not scene.reducer.full_order:
        for key, value in scene.unvaried_loads.items():
            name = key.split(".")[1]
            yield Note(f"{key} is {value:g} at all times, so that no training run varies it: give "
                       f"its range (training.loads: {{{name}: [smallest, largest]}})",
                       "unvaried_load")


class FewAtoms(Check):
    """Blocks that are reduced to one atom, or to fewer than were asked for."""

    order = place("few_atoms")

    def before_steps(self, run: PreparedRun, again: PreparedRun | None) -> Findings:
        return Findings(of_solver(run.scene, run.solver))


def of_solver(scene: Scene, solver: StepSolver) -> tuple[Note, ...]:
    """Warnings about blocks that are reduced to one atom (basis vector) although more exist;
    information on those that have fewer atoms than the options ask for."""
    found = []
    for name, d in solver.dictionaries.items():
        # rank of the snapshots, as POD reports it; of other bases more than one atom is assumed
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
    reducer = scene.reducer
    chosen = reducer.trial_bases()
    if chosen is None:
        return 0
    count = getattr(matched_option(block, chosen.others, chosen.shared), "count", None)
    budget = matched_option(block, getattr(reducer, "budgets", {}), None)
    limits = (count, getattr(budget, "atoms", None))
    return max((n for n in limits if isinstance(n, int)), default=0)
