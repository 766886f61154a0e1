"""Laws of a reducer and its step solver, on a scene small enough to run many times."""

from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.assemble import assemble
from sparsemor.core.hooks import new_manager
from sparsemor.core.initial import consistent_state
from sparsemor.core.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.offline import Offline, train
from sparsemor.core.protocols import StepSolver
from sparsemor.core.saved import Saved, SavedError
from sparsemor.core.scene import Scene
from sparsemor.core.testing.data import law


def check_reducer(scene: Scene, seed: int = 0, steps: int = 6) -> None:
    """The scene's reducer: unknowns that its dictionaries explain, steps that write to nothing
    they were given, memory that can be stored and continued from, equal numbers for equal seeds.

    The scene is trained by its own full-order run, so keep it short.
    """
    model = assemble(scene)
    snapshots = {n: s.T for n, s in train(scene.for_training(), new_manager()).items()}
    first = _march(scene, model, snapshots, seed, steps, broken=None)
    again = _march(scene, model, snapshots, seed, steps, broken=None)
    law(np.array_equal(first, again), f"two runs of one seed differ (seed {seed})")
    resumed = _march(scene, model, snapshots, seed, steps, broken=steps // 2)
    law(np.array_equal(first, resumed),
        f"a run that is continued from its stored memory differs (seed {seed})")


def _march(
    scene: Scene, model: Model, snapshots: dict[str, FloatArray], seed: int, steps: int,
    broken: int | None,
) -> FloatArray:
    h, integrator = scene.time.step, scene.integrator
    solver: StepSolver = scene.reducer.prepare(
        model, integrator, h, Offline.of(model, snapshots), np.random.default_rng(seed))
    _solver(solver, model)
    state, memory = solver.start(consistent_state(model))
    state = integrator.start(solver.layout, state)
    kept = []
    for n in range(steps):
        formula = integrator.formula(solver.layout, state, h)
        given = [formula.r1.copy(), formula.r2.copy(), state.x.copy()]
        if n == broken:
            memory = _restored(solver, model, memory)
        outcome, memory = solver.solve(formula, memory)
        law(all(np.array_equal(a, b) for a, b in
                zip(given, (formula.r1, formula.r2, state.x), strict=True)),
            "solve wrote to the step or to the state before it")
        law(outcome.status.ok, f"step {n + 1} ended {outcome.status.value} in {outcome.block}")
        law(outcome.x.shape == (solver.layout.size,), f"x has shape {outcome.x.shape}")
        law(bool(np.isfinite(outcome.x).all()), "status done with values that are not finite")
        law(outcome.iterations >= 1, "a step takes at least one iteration")
        state = integrator.advance(solver.layout, state, formula, outcome.x, h)
        kept.append(state.x.copy())
        _memory(solver, memory)
    return np.array(kept)


def _restored(solver: StepSolver, model: Model, memory: Any) -> Any:
    """The memory as `--resume` gets it: written as plain data, read into one of the start."""
    try:
        stored = Saved.of(memory).dump()
        return Saved.load(stored).into(solver.start(consistent_state(model))[1])
    except (TypeError, SavedError) as error:
        raise AssertionError(f"the memory cannot be stored and read again: {error}") from None


def _solver(solver: StepSolver, model: Model) -> None:
    full = {b.name: b.size for b in model.layout}
    own = {b.name: b.size for b in solver.layout}
    law(list(own) == list(full), "the blocks differ from the model's")
    for name, size in own.items():
        d = solver.dictionaries.get(name)
        if d is None:
            law(size == full[name], f"{name} has another size and no dictionary")
            continue
        law(d.atoms.shape == (full[name], size), f"{name}: atoms {d.atoms.shape}")
        law(d.offset.shape == (full[name],), f"{name}: offset {d.offset.shape}")
    for name, rows in solver.rows.items():
        law(bool(np.all(np.diff(rows) > 0)) and rows.max(initial=0) < full[name],
            f"{name}: rows are not sorted, distinct and inside the block")
    law(all(n >= 0 for n in solver.elements_touched.values()), "elements_touched is negative")
    law(all(isinstance(n, Note) and n.text for n in solver.notes), "a note has no text")
    law(all(isinstance(v, float | int | str) for f in solver.facts.values() for v in f.values()),
        "facts may hold numbers and strings only")


def _memory(solver: StepSolver, memory: Any) -> None:
    for name, support in solver.supports(memory).items():
        at = solver.layout[name]
        law(support.shape == (at.stop - at.start,) and support.dtype == np.bool_,
            f"{name}: support must be bool of the block's size")
    law(all(isinstance(n, int) and n >= 0 for n in solver.counters(memory).values()),
        "counters must be whole numbers")
