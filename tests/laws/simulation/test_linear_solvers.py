"""Orderings, fill, choice and failures of linear solvers; what their law kit catches."""

from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from sparsemor.bodies.fem import elasticity, integrals
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core import DofLocations, LinearSolver
from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.linear_solver_checks import Solved, relative_residuals, rigid_motions
from sparsemor.core.linalg.nested_dissection import dissect
from sparsemor.core.status import Status
from sparsemor.core.testing import check_linear_solver
from sparsemor.core.testing.linear_solver import random_heat, random_lattice
from sparsemor.plugins.linear_solvers import auto as auto_module
from sparsemor.plugins.linear_solvers.auto import AutomaticSolver
from sparsemor.plugins.linear_solvers.cholmod import Cholmod
from sparsemor.plugins.linear_solvers.conjugate_gradients import ConjugateGradients
from sparsemor.plugins.linear_solvers.pardiso import Pardiso
from sparsemor.plugins.linear_solvers.smoothed_aggregation import SmoothedAggregation
from sparsemor.plugins.linear_solvers.superlu import CHUNK, ENTRY, Splu, chunked

PACKAGE = {"pardiso": "pypardiso", "cholmod": "sksparse", "amg": "pyamg"}
STEEL = Isotropic(E=200e9, nu=0.3, rho=7850, alpha=12.3e-6, k=44.5, c=475)


def block(n: int) -> Any:
    return BlockMesh(size=(1.0, 1.0, 1.0), divisions=(n, n, n)).build(Path())


def heat(n: int, h: float) -> tuple[Csr, DofLocations]:
    """Capacity over a step of h s, and conduction, of a block of n^3 cells."""
    mesh = block(n)
    A = integrals.capacity(mesh, 7850, 475) / h + integrals.conductivity(mesh, 44.5)
    return A.tocsr(), DofLocations(mesh.points, np.zeros(len(mesh.points), np.int64))


def elastic(n: int) -> tuple[Csr, DofLocations]:
    """Stiffness of a block clamped on the left, its top held in z only."""
    mesh = block(n)
    left, top = mesh.point_sets["left"], mesh.point_sets["top"]
    held = np.concatenate([(3 * left[:, None] + np.arange(3)).ravel(), 3 * top + 2])
    free = np.setdiff1d(np.arange(3 * len(mesh.points)), held)
    K = elasticity.elastic_stiffness(mesh, STEEL, 1.0, "solid")[free][:, free]
    return K, DofLocations(mesh.points[free // 3], free % 3)


@pytest.mark.parametrize("columns", [1, CHUNK, CHUNK + 1, 3 * CHUNK + 5])
def test_superlu_solves_for_many_columns_in_chunks(columns: int) -> None:
    A, places = elastic(3)
    b = np.random.default_rng(1).standard_normal((A.shape[0], columns))
    widths: list[int] = []

    def solve(part: FloatArray) -> FloatArray:
        widths.append(part.shape[1])
        return np.linalg.solve(A.toarray(), part)

    expected = np.linalg.solve(A.toarray(), b)
    size = np.abs(expected).max()
    assert np.allclose(chunked(solve)(b), expected, rtol=0.0, atol=1e-13 * size)
    assert sum(widths) == columns
    assert max(widths) <= CHUNK and max(widths) - min(widths) <= 1
    for ordering in ("minimum_degree", "dissection"):
        x = Splu(ordering=ordering).factorize(A, places).solve(b)
        assert np.allclose(x, expected, rtol=0.0, atol=1e-12 * size)


@pytest.mark.parametrize("solver", [
    Splu(ordering="minimum_degree"), Splu(ordering="columns", symmetric=False),
    AutomaticSolver(rtol=1e-7), ConjugateGradients(rtol=1e-7),
])
def test_other_options_keep_the_laws(solver: LinearSolver) -> None:
    check_linear_solver(solver, trials=1)


@pytest.mark.parametrize("cls,name", [(Pardiso, "pardiso"), (Cholmod, "cholmod"),
                                      (SmoothedAggregation, "amg")])
def test_a_missing_package_is_told_with_its_extra(
    cls: type[Any], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from sparsemor.core.registry import installed as extras

    monkeypatch.setattr(extras, "find_spec", lambda module: None)
    with pytest.raises(InputError, match=rf"{PACKAGE[name]}.*sparsemor\[{name}\]"):
        cls().factorize(sparse.csr_array(np.eye(3)))


@pytest.mark.parametrize("make", [random_heat, random_lattice])
def test_dissection_tells_the_entries_of_the_factor(make: Any) -> None:
    """Against a dense Cholesky factorization in that order; numbers may cancel, entries not."""
    for seed in range(10):
        A, places = make(np.random.default_rng(seed))
        found = dissect(A, places)
        assert np.array_equal(np.sort(found.order), np.arange(A.shape[0]))
        filled = np.tril(symbolic(A.toarray()[np.ix_(found.order, found.order)] != 0))
        assert filled.sum() <= found.entries


def symbolic(pattern: Any) -> Any:
    """Entries that elimination in the given order makes, one unknown after the other."""
    full = pattern.copy()
    for k in range(len(full)):
        below = k + 1 + np.flatnonzero(full[k + 1:, k])
        full[np.ix_(below, below)] = True
    return full


@pytest.mark.full
def test_dissection_predicts_and_lowers_the_fill_in_space() -> None:
    A, places = elastic(16)
    done = Splu(ordering="dissection").factorize(A, places)
    assert done.outcome(np.ones((A.shape[0], 2))).residual < 1e-11
    by_parts = done.memory
    by_degree = Splu(ordering="minimum_degree").factorize(A, places).memory
    told = 2 * ENTRY * dissect(A, places).entries
    assert by_parts < 0.7 * by_degree
    assert 0.85 * told < by_parts <= 1.02 * told
    assert Splu().factorize(A, places).memory == by_parts  # best


def test_dissection_needs_positions() -> None:
    with pytest.raises(InputError, match="positions") as caught:
        Splu(ordering="dissection").factorize(heat(2, 1.0)[0])
    assert caught.value.faults[0].key == "ordering"


def test_rigid_motions_cost_no_force() -> None:
    mesh = block(2)
    K = elasticity.elastic_stiffness(mesh, STEEL, 1.0, "solid")
    n = 3 * len(mesh.points)
    motions = rigid_motions(DofLocations(mesh.points[np.arange(n) // 3], np.arange(n) % 3))
    assert motions.shape == (n, 6) and np.linalg.matrix_rank(motions) == 6
    assert np.abs(K @ motions).max() < 1e-12 * np.abs(K).max()
    plane = DofLocations(np.random.default_rng(0).random((8, 2)), np.arange(8) % 2)
    assert rigid_motions(plane).shape == (8, 3)
    scalar = DofLocations(plane.coordinates, np.zeros(8, np.int64))
    assert rigid_motions(scalar).tolist() == [[1.0]] * 8


def test_matrices_have_symmetric_patterns() -> None:
    """Entries that cancel are left out on both sides, not kept where their sum is round-off."""
    for A in (heat(6, 1.0)[0], elastic(6)[0]):
        size, s = A.tocoo(), np.sqrt(A.diagonal())
        assert ((A != 0) != (A.T != 0)).nnz == 0
        assert (np.abs(size.data) > 1e-14 * s[size.row] * s[size.col]).all()


def test_a_warm_start_saves_iterations() -> None:
    A, places = heat(6, 1.0)
    done = ConjugateGradients().factorize(A, places)
    b = np.random.default_rng(0).random(A.shape[0])
    cold = done.outcome(b)
    near = done.outcome(1.001 * b, cold.x)
    assert 0 < near.iterations <= 0.8 * cold.iterations
    assert done.outcome(b, cold.x).iterations == 0


@pytest.mark.full
def test_multigrid_does_not_notice_the_mesh() -> None:
    pytest.importorskip("pyamg")
    counts = []
    for n in (8, 10, 12):
        A, places = elastic(n)
        outcome = SmoothedAggregation().factorize(A, places).outcome(np.ones(A.shape[0]))
        assert outcome.status is Status.DONE and outcome.residual <= 1e-10
        counts.append(outcome.iterations)
    A, places = elastic(12)
    blind = SmoothedAggregation().factorize(A).outcome(np.ones(A.shape[0]))
    plain = ConjugateGradients().factorize(A).outcome(np.ones(A.shape[0]))
    assert max(counts) <= min(counts) + 2 and 2 * counts[-1] < blind.iterations < plain.iterations


def test_too_few_iterations_are_not_called_solved() -> None:
    A, places = elastic(4)
    done = ConjugateGradients(max_iterations=3).factorize(A, places)
    b = np.stack([np.ones(A.shape[0]), np.zeros(A.shape[0])], axis=1)
    outcome = done.outcome(b)
    assert outcome.status is Status.NOT_CONVERGED and outcome.iterations == 3
    assert outcome.residual == relative_residuals(A, outcome.x, b).max() > 1e-3
    x = done.solve(b)
    assert np.isnan(x[:, 0]).all() and not x[:, 1].any()  # the other column is solved


@pytest.mark.parametrize("name", ["splu", "cholmod", "pardiso"])
def test_a_body_that_nothing_holds_is_singular(name: str) -> None:
    if name in PACKAGE:
        pytest.importorskip(PACKAGE[name])
    (entry,) = entry_points(group="sparsemor.linear_solver", name=name)
    K = elasticity.elastic_stiffness(block(3), STEEL, 1.0, "solid")
    done = entry.load()().factorize(K)
    assert done.status is Status.SINGULAR and done.note
    assert np.isnan(done.solve(np.ones(K.shape[0]))).all()
    assert done.outcome(np.ones(K.shape[0])).status is Status.SINGULAR


@pytest.mark.full
def test_auto_says_what_it_took_and_why() -> None:
    small, places = heat(4, 1.0)
    assert AutomaticSolver().factorize(small, places).note == "splu: 125 unknowns are few"
    A, places = heat(16, 1.0)
    done = AutomaticSolver(rtol=1e-4).factorize(A, places)  # few iterations for few digits
    assert done.solver == "cg" and done.note.startswith("cg: ")
    assert "iterations cost less than a solve with factors of" in done.note
    steady, places = heat(16, 1e7)  # hundreds of iterations: the factors are cheaper
    done = AutomaticSolver(memory=4.0).factorize(steady, places)
    assert done.solver in {"splu", "cholmod", "pardiso"}
    assert "fit in 4 GB" in done.note


@pytest.mark.full
def test_auto_leaves_factors_that_do_not_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    A, places = elastic(10)
    tight = AutomaticSolver(memory=1e-3)
    monkeypatch.setattr(auto_module, "find_spec", lambda module: module == "pyamg" or None)
    solver, note = tight.choose(A, places)
    assert isinstance(solver, SmoothedAggregation) and "exceed 0.001 GB" in note
    monkeypatch.setattr(auto_module, "find_spec", lambda module: None)
    solver, note = tight.choose(A, places)
    assert isinstance(solver, ConjugateGradients) and "install the extra amg" in note
    b = np.ones(A.shape[0])
    assert solver.factorize(A, places).outcome(b).status is Status.DONE
    A, places = heat(16, 1.0)
    solver, note = tight.choose(A, places)
    assert isinstance(solver, ConjugateGradients) and "install" not in note
    assert tight.choose(A)[1].startswith("cg: factors of")  # positions unknown


@pytest.mark.full
def test_multigrid_neither_reads_nor_moves_the_global_generator() -> None:
    pytest.importorskip("pyamg")
    A, places = elastic(8)  # more unknowns than the coarsest level has
    solutions = []
    for seed in (7, 8):
        np.random.seed(seed)
        want = np.random.random()
        np.random.seed(seed)
        done = SmoothedAggregation().factorize(A, places)
        assert np.random.random() == want
        solutions.append(done.solve(np.ones(A.shape[0])))
    assert np.array_equal(*solutions)


class Broken(LinearSolver):
    """A solver with one fault."""

    fault: str

    def factorize(self, A: Csr, places: DofLocations | None = None) -> Any:
        fault = self.fault
        if fault == "accepts all":
            return Solved("broken", A, direct=lambda b: np.linalg.lstsq(A.toarray(), b)[0])
        if fault == "wrong":
            return Solved("broken", A, column=lambda b, s: (b / A.diagonal(), 1), rtol=1e9)
        good = Splu().factorize(A, places)
        if not good.status.ok:
            return Solved("broken", A, direct=np.zeros_like) if fault == "hides" else good

        def apply(b: FloatArray) -> FloatArray:
            x = good.solve(b)
            if fault == "writes" and b.size:
                b *= 2.0
            if fault == "not repeatable":
                x = x * (1.0 + 1e-9 * np.random.default_rng().random(x.shape))
            return x

        def column(b: FloatArray, start: FloatArray | None) -> tuple[FloatArray, int]:
            return good.solve(b), 3 if start is not None else 2

        if fault == "slow start":
            return Solved("broken", A, column=column)
        return Solved("broken", A, memory=-1 if fault == "memory" else 0, direct=apply)


@pytest.mark.parametrize("fault,words", [
    pytest.param("accepts all", "gives numbers for a failure", marks=pytest.mark.full),
    ("wrong", "solved with a residual|has a relative error"),
    ("hides", "gives numbers for a failure"),
    ("writes", "wrote to b|read-only"),
    ("not repeatable", "two solves differ"),
    ("slow start", "iterations from the solution"),
    ("memory", "memory -1"),
])
def test_a_broken_linear_solver_fails_its_law(fault: str, words: str) -> None:
    with pytest.raises((AssertionError, InputError), match=words):
        check_linear_solver(Broken(fault=fault), trials=2)
