"""Steps with a term between bodies: full order and reduced models, solved as a whole."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import pytest

from reduced_runs import decoded, learnt
from small_scenes import SCENES
from sparsemor.core import ReducedProblem, ReducedTerm, State, Term
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.step_solver import AroundSteps
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.testing.in_memory_run import March, march
from sparsemor.core.testing.term import check_term
from sparsemor.plugins.stability.step_map import step_map
from sparsemor.reducers.step.coupled_reduced import ReducedGeneral
from sparsemor.reducers.step.monolithic_step import WholeStepper
from springs import bars, coupled, with_other

pytestmark = pytest.mark.full


@cache
def short() -> Scene:
    return load(SCENES / "everything.yaml", {"time.end": 0.016})


def nowhere() -> IntArray:
    return np.zeros(0, np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Nothing(ReducedTerm, Term):
    """A term without rows: it only asks for the general path."""

    rows: IntArray = field(default_factory=nowhere)
    columns: IntArray = field(default_factory=nowhere)
    elements: int = 0

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return np.zeros(0)

    def jacobian(self, *args: Any) -> FloatArray:
        return np.zeros((0, 0))

    def restrict(self, keep: IntArray) -> "Nothing":
        return self

    def compress(self, trial: Any, left: FloatArray) -> "Nothing":
        return self


def errors(run: March, reference: March) -> dict[str, float]:
    """Largest difference of each block after the start, relative to its largest value."""
    return {b.name: float(np.abs(decoded(run, b.name) - reference.block(b.name))[1:].max()
                          / np.abs(reference.block(b.name)).max()) for b in reference.model.layout}


def changes(run: March, name: str) -> FloatArray:
    """A block in its full unknowns, temperatures less what they start from: Galerkin's coordinates
    in a span are its own choice."""
    d = run.solver.dictionaries.get(name)
    return run.block(name) if d is None else run.block(name) @ d.atoms.T


def whole(model: Model) -> dict[str, FloatArray]:
    """Snapshots whose POD spans each block completely."""
    rng = np.random.default_rng(0)
    sizes = {n: model.layout[n].stop - model.layout[n].start for n in model.reducible()}
    return {n: np.linalg.qr(rng.standard_normal((k, k)))[0] for n, k in sizes.items()}


# --------------------------------------------------------------------------- the same equations


def test_the_springs_are_a_term() -> None:
    """The law kit, where rates of both orders differ as well as where they agree."""
    model = coupled(bars())
    term = model.separated.other[0]
    base = model.x0[term.columns]
    check_term(term, np.random.default_rng(1), base, scale=0.01, trials=2, same_rates=True)


@cache
def everything() -> March:
    return march(short())


ROWS = {"*.elastic": {"rows": 8}, "*.thermal": {"rows": 0}}
SCALED = {"use": "sparse", "budgets": ROWS, "preconditioner": "row_scaling"}
INVERSE = {"use": "sparse", "budgets": ROWS, "residual": {"*.elastic": "preconditioned"}}


@pytest.mark.parametrize("options", [
    {"use": "galerkin"}, {"use": "deim"}, {"use": "gnat"}, {"use": "lspg"}, {"use": "ecsw"},
    {"use": "sparse", "budgets": ROWS}, SCALED, INVERSE], ids=str)
def test_without_a_coupling_term_both_paths_are_one(options: Mapping[str, Any]) -> None:
    """Joints of all kinds, loads, radiation, fixed frames and given temperatures."""
    full = everything()
    # least squares multiply the rounding of rates, which one path updates by the change: 2.6e-9 of
    # lspg and gnat, the same at `remaining` 1e-15; 4.5e-9 of sparse without AVX-512
    own = 1e-8 if options["use"] in ("sparse", "lspg", "gnat") else 1e-9
    # atoms at round-off change with every digit; one seed of eight has rows unstable in them
    scene = short().using({"reducer": options, "seed": 1})
    fast = march(scene, model=full.model, snapshots=learnt(full))
    general = march(scene, model=with_other(full.model, Nothing()), snapshots=learnt(full))
    assert isinstance(general.solver, ReducedGeneral)
    assert not isinstance(fast.solver, ReducedGeneral)
    for b in fast.solver.layout:
        one, other = changes(fast, b.name)[1:], changes(general, b.name)[1:]
        tolerance = 1e-6 if b.field == "multiplier" else own
        assert np.abs(one - other).max() < tolerance * np.abs(one).max(), b.name


def test_a_kept_factor_changes_no_step() -> None:
    scene = bars()
    model = coupled(scene)
    chord, textbook = (march(scene.using({"reducer": {"use": "full", "method": m}}), model=model)
                       for m in ("bordered", "newton"))
    assert isinstance(chord.solver, WholeStepper)
    assert max(errors(chord, textbook).values()) < 1e-9
    assert np.abs(chord.block("one.elastic")).max() > 1e-6  # the springs do bend the bars


# --------------------------------------------------------------------------- reduced models


@pytest.mark.parametrize("integrator", ["bdf2", "generalized_alpha"])
def test_a_complete_basis_is_full_order(integrator: str) -> None:
    """Mechanics and heat coupled across the bodies, rates of both orders different."""
    scene = bars(integrator=integrator)
    model = coupled(scene)
    full = march(scene, model=model)
    run = march(scene.using({"reducer": "galerkin"}), model=model, snapshots=whole(model))
    found = errors(run, full)
    forces = [found.pop(n) for n in ("a.multiplier", "b.multiplier")]
    assert max(found.values()) < 1e-8 and max(forces) < 1e-6, found
    warmed = full.block("two.thermal")[-1] - full.block("two.thermal")[0]
    assert warmed.max() > 0.1


@pytest.mark.parametrize("options", [
    {"use": "galerkin"}, {"use": "galerkin", "basis": {"use": "pod", "centred": True}},
    {"use": "deim"}, {"use": "gnat"}, {"use": "lspg"},
    {"use": "sparse", "budgets": {"*.elastic": {"rows": 35}, "*.thermal": {"rows": 20}}}], ids=str)
def test_a_run_that_was_learnt_is_given_back(options: Mapping[str, Any]) -> None:
    scene = bars()
    model = coupled(scene)
    full = march(scene, model=model)
    run = march(scene.using({"reducer": options}), model=model, snapshots=learnt(full))
    assert max(errors(run, full).values()) < 1e-6
    assert run.solver.layout.size < 0.7 * full.solver.layout.size


def test_what_a_step_visits_does_not_grow_with_the_mesh() -> None:
    sizes = []
    for divisions in ((8, 2), (24, 6)):
        scene = bars(divisions)
        model = coupled(scene)
        full = march(scene.using({"time.end": 0.003}), model=model)
        run = march(scene.using({"time.end": 0.003, "reducer": {
            "use": "galerkin", "basis": {"use": "pod", "count": 3}}}),
            model=model, snapshots=learnt(full))
        solver = run.solver
        assert isinstance(solver, ReducedGeneral)
        assert "springs" in solver.notes[-1].text and "3 elements" in solver.notes[-1].text
        inner: Any = solver.equations.coupled[0].term
        sizes.append((dict(solver.elements_touched), solver.layout.size, inner.atoms.shape))
    assert sizes[0] == sizes[1]
    assert set(sizes[0][0].values()) == {3}


def test_sparse_without_a_choice_only() -> None:
    scene = bars(reducer={"use": "sparse", "basis": {"use": "pod", "count": 5}, "resample": 2,
                          "budgets": {"*": {"rows": 20, "atoms": 3}}})
    faults = scene.reducer.check(coupled(scene))
    assert [f.key for f in faults] == ["resample", *["budgets.*.atoms"] * 4]
    assert all("springs couples bodies" in f.message for f in faults)
    late = scene.using({"reducer": {"use": "sparse", "budgets": {"*": {"rows": 20, "atoms": 3}}}})
    model = coupled(late)
    snapshots = {n: s[:, :5] for n, s in whole(model).items()}
    with pytest.raises(InputError, match="3 of 5 atoms would be selected"):
        late.reducer.prepare(ReducedProblem(
            model, late.integrator, 1e-3, Offline.from_snapshots(
                model, snapshots), np.random.default_rng(0)))


class ByDifferences(AroundSteps[Any]):
    """The same solver without its own response."""

    def start(self, state: State) -> Any:
        return self.base.start(state)

    def solve(self, step: Any, memory: Any) -> Any:
        return self.base.solve(step, memory)


def test_the_response_of_a_step_is_its_derivative() -> None:
    """What the stability check linearises with, for both orders of rates."""
    scene = bars(integrator={"use": "generalized_alpha", "rho_inf": 0.7})
    model = coupled(scene)
    full = march(scene, model=model)
    scene = scene.using({"reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 6}}})
    solver: Any = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, 1e-3, Offline.from_snapshots(
            model, learnt(full)), np.random.default_rng(0)))
    state, memory = solver.start(consistent_state(model))
    state = scene.integrator.start(solver.layout, state)
    exact, near = (step_map(s, scene.integrator, 1e-3, state, memory)
                   for s in (solver, ByDifferences(solver)))
    size = np.abs(exact.response).max(axis=0) + 1e-12 * np.abs(exact.response).max()
    assert np.abs(exact.response - near.response).max(axis=0).max() > 0.0
    assert (np.abs(exact.response - near.response).max(axis=0) < 1e-4 * size).all()
