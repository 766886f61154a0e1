"""Bodies whose frames are given: their elastic blocks are linear and cost what they read."""

from dataclasses import replace

import numpy as np
import pytest

from sparsemor.core import Dictionary
from sparsemor.core.testing.in_memory_run import March, march
from sparsemor.reducers.linalg.modal_coordinates import modal_coordinates
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from sparsemor.reducers.step.reduced_equations import Reduced
from sparsemor.reducers.step.reduced_mechanics import LoopMechanics, ReducedMechanics
from turning_bars import bar, plane_bar, turning

TURNING = [(5e12, 60.0), (5e5, 60.0), (5e4, 400.0)]
"""Pa, rad/s"""


def differ(one: March, other: March) -> float:
    """Largest difference of displacements relative to the largest."""
    x, y = one.block("bar.elastic"), other.block("bar.elastic")
    assert np.abs(y).max() > 0
    return float(np.abs(x - y).max() / np.abs(y).max())


@pytest.mark.full
@pytest.mark.parametrize("make, size, E, spin", [
    (bar, 4, *TURNING[0]), (plane_bar, 3, *TURNING[1]), (bar, 4, *TURNING[2]),
    (plane_bar, 3, *TURNING[2])])
def test_what_turns_with_the_frame_is_solved_for_however_much_it_is(make, size, E, spin) -> None:
    """From a contraction of 1e-4 to one that has to be accelerated, against the textbook Newton."""
    fast = march(make(E), model=turning(make(E), spin, size))
    scene = make(E, method="newton")
    assert differ(fast, march(scene, model=turning(scene, spin, size))) < 1e-9
    most = max(fast.iterations)
    assert most <= 4 if E == 5e12 else most > 4, fast.iterations


@pytest.mark.parametrize("make, size", [
    pytest.param(bar, 4, marks=pytest.mark.full), (plane_bar, 3)])
def test_atoms_that_hold_the_motion_repeat_it(make, size) -> None:
    """In full order's solution, stiffness, damping, Coriolis and heat under the atoms are right."""
    scene = make(5e6)
    full = march(scene, model=turning(scene, 60.0, size))
    names = [b.name for b in full.model.layout]
    snapshots = {n: full.block(n).T.copy() for n in names}
    reduced = make(5e6, use="galerkin", basis="pod")
    got = march(reduced, model=turning(reduced, 60.0, size), snapshots=snapshots)
    atoms = got.solver.dictionaries["bar.elastic"].atoms
    x, y = got.block("bar.elastic") @ atoms.T, full.block("bar.elastic")
    assert atoms.shape[1] < atoms.shape[0]
    assert np.abs(x - y)[1:].max() < 1e-8 * np.abs(y).max()


@pytest.mark.full
@pytest.mark.parametrize("make, size, polish", [(bar, 4, True), (plane_bar, 3, False)])
def test_atoms_are_chosen_without_the_forms_that_only_rigid_equations_need(
    make, size, polish,
) -> None:
    """As published, from a full basis; of 7018 atoms the forms took minutes and most of a step."""
    scene = make(5e6)
    full = march(scene, model=turning(scene, 60.0, size))
    names = [b.name for b in full.model.layout]
    snapshots = {n: full.block(n).T.copy() for n in names}
    budgets = {n: {"rows": len(S), "atoms": 9} for n, S in snapshots.items()}
    chosen = make(5e6, use="sparse", basis={"use": "pod", "complete": True}, polish=polish,
                  selection="blocks" if polish else "joint",
                  sampler={"use": "lhs", "required": False}, budgets=budgets)

    got = march(chosen, model=turning(chosen, 60.0, size), snapshots=snapshots)
    assert got.solver.dictionaries["bar.elastic"].atoms.shape[1] == len(snapshots["bar.elastic"])
    x, y = got.block("bar.elastic"), full.block("bar.elastic")
    x = x @ got.solver.dictionaries["bar.elastic"].atoms.T
    assert np.abs(x - y)[1:].max() < 1e-6 * np.abs(y).max()
    assert not got.solver.steps.elastic["bar.elastic"].compressed[0].quadratic.size


def equations(solver: object) -> Reduced:
    assert isinstance(solver, BlockwiseSolver) and isinstance(solver.mechanics, ReducedMechanics)
    return solver.mechanics.equations


@pytest.fixture(scope="module")
def full() -> March:
    scene = bar(5e6)
    return march(scene, model=turning(scene, 60.0, 4))


def reduced(full: March, reducer: dict[str, object]) -> March:
    snapshots = {b.name: full.block(b.name).T.copy() for b in full.model.layout}
    scene = bar(5e6, **reducer)
    return march(scene, model=turning(scene, 60.0, 4), snapshots=snapshots)


def test_atoms_are_modes_of_the_same_span(full) -> None:
    (body,) = full.model.separated.moving
    K, M, rng = body.operators.stiffness, body.operators.mass, np.random.default_rng(3)
    A = np.linalg.qr(rng.standard_normal((K.shape[0], 7)))[0]
    old = Dictionary(A, np.zeros(len(A)), tuple("abcdefg"))
    found = modal_coordinates(old, K, M, "Hz")
    assert found is not None
    d, growth = found
    B = d.atoms
    assert np.allclose(np.linalg.norm(B, axis=0), 1.0) and len(set(d.provenance)) == 7
    assert np.abs(B - A @ (A.T @ B)).max() < 1e-13
    for small in (B.T @ (K @ B), B.T @ (M @ B)):
        size = np.sqrt(np.diag(small))
        assert np.abs(small / np.outer(size, size) - np.eye(7)).max() < 1e-10
    rates = np.diag(B.T @ (K @ B)) / np.diag(B.T @ (M @ B))
    assert (np.diff(rates) > 0).all()
    assert d.provenance[0] == f"mode at {np.sqrt(rates[0]) / (2 * np.pi):.4g} Hz"
    # what a coefficient can be at most grows by no more than is told
    c = rng.uniform(-1.0, 1.0, (7, 200))
    new = np.linalg.lstsq(B, A @ c, rcond=None)[0]
    assert np.abs(new).max() <= growth < 100.0


def test_atoms_that_are_not_orthonormal_keep_their_coordinates(full) -> None:
    run = reduced(full, {"use": "galerkin", "basis": "static"})
    d = run.solver.dictionaries["bar.elastic"]
    assert d.provenance[0].startswith("static") and "coordinates" not in d.info
    (body,) = full.model.separated.moving
    doubled = replace(d, atoms=np.hstack([d.atoms, d.atoms]), provenance=d.provenance * 2)
    assert modal_coordinates(doubled, body.operators.stiffness, body.operators.mass, "Hz") is None


@pytest.mark.full
@pytest.mark.parametrize("E, spin", TURNING)
def test_full_order_corrected_in_soft_modes_is_that_of_newton(E, spin) -> None:
    fine = (8, 3, 2)  # enough unknowns for it to have any
    fast = march(bar(E, fine), model=turning(bar(E, fine), spin, 4))
    assert isinstance(fast.solver, BlockwiseSolver)
    mechanics = fast.solver.mechanics
    assert isinstance(mechanics, LoopMechanics)
    assert mechanics.equations.bodies[0].coarse.Z.shape[1] > 0
    scene = bar(E, fine, method="newton")
    assert differ(fast, march(scene, model=turning(scene, spin, 4))) < 1e-9
