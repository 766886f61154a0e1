"""A reducer of another package does in a step what galerkin does: counted, not timed."""

import ast
import sys
from collections import Counter
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from public_names import PUBLIC, ours
from sparsemor.core import ReducedProblem, State
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.time_stepping import FixedStep, accepted_steps, started
from sparsemor.core.testing.in_memory_run import march

TESTS = Path(__file__).parents[2]
SAMPLE = TESTS / "third_party" / "sparsemor-sample" / "sparsemor_sample.py"
LINES = 30
TRIAL = {"basis": {"use": "pod", "count": 5}, "bases": {"*.thermal": {"use": "pod", "count": 4}}}


def oblique() -> Any:
    """The reducer `oblique` of the sample package, with test functions from weighted
    snapshots."""
    spec = spec_from_file_location("sparsemor_sample", SAMPLE)
    assert spec is not None and spec.loader is not None
    module: Any = module_from_spec(spec)
    spec.loader.exec_module(module)
    weighted = {"use": "pod", "weights": "inverse_sqrt_norm"}
    return module.Oblique.model_validate({**TRIAL, "test": weighted})


@cache
def trained() -> tuple[Scene, Model, dict[str, Any]]:
    """A heated, radiating bar on a pin, its model and snapshots of 15 steps."""
    scene = load(TESTS / "scenes" / "tiny.yaml", {
        "time.end": 0.015, "reducer": "full",
        "loads.glow": {"use": "radiation", "on": ["bar:top"], "emissivity": 0.9,
                       "surroundings": 293.15}})
    model = assemble(scene)
    full = march(scene, model=model)
    return scene, model, {name: full.block(name).T for name in model.reducible()}


class Counted:
    """A prepared reducer with the numbers of what its preparation and one later step do."""

    def __init__(self, reducer: Any) -> None:
        base, model, snapshots = trained()
        scene = base.using({"reducer": reducer})
        before = sum(f.count for f in model.solvers.log)
        self.solver: Any = scene.reducer.prepare(ReducedProblem(
            model, scene.integrator, scene.time.step, Offline.from_snapshots(model, snapshots),
            np.random.default_rng(0)))
        state, memory = started(self.solver, scene.integrator, consistent_state(model))
        h = scene.time.step
        step = FixedStep.of(scene.integrator, self.solver, h)
        taken = list(accepted_steps(step, state, memory, 8, h))[-1]
        self.end: State = taken.state
        self.iterations = taken.outcome.iterations
        self.factorizations = sum(f.count for f in model.solvers.log) - before
        self.calls: Counter[str] = Counter()

        def count(frame: Any, event: str, argument: Any) -> None:
            if event in ("call", "c_call"):
                self.calls[event] += 1

        sys.setprofile(count)
        try:
            list(accepted_steps(step, taken.state, taken.memory, 1, h))
        finally:
            sys.setprofile(None)


@pytest.mark.full
def test_it_does_in_a_step_what_galerkin_does() -> None:
    own, theirs = Counted({"use": "galerkin", **TRIAL}), Counted(oblique())
    assert type(theirs.solver) is type(own.solver)
    assert theirs.factorizations == own.factorizations
    assert theirs.solver.elements_touched == own.solver.elements_touched
    assert theirs.solver.elements_touched["bar.thermal"] > 0  # radiation is evaluated
    assert {n: len(r) for n, r in theirs.solver.rows.items()} == {
        n: len(r) for n, r in own.solver.rows.items()}
    assert theirs.solver.layout.size == own.solver.layout.size
    assert abs(theirs.iterations - own.iterations) <= 1
    assert 100 < sum(theirs.calls.values()) <= 1.2 * sum(own.calls.values())


def test_it_is_short_and_imports_public_names_alone() -> None:
    source = SAMPLE.read_text(encoding="utf-8")
    (found,) = (n for n in ast.parse(source).body
                if isinstance(n, ast.ClassDef) and n.name == "Oblique")
    assert found.end_lineno is not None and found.end_lineno - found.lineno < LINES
    assert ours(source) <= PUBLIC
