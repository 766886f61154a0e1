"""Law kit of a linear solver."""

from collections.abc import Callable

import numpy as np
from scipy import sparse

from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.linalg.linear_solver_checks import relative_residuals
from sparsemor.core.protocols.linear_solver import (
    DofLocations,
    Factorized,
    LinearOutcome,
    LinearSolver,
)
from sparsemor.core.status import Status
from sparsemor.core.testing.random_inputs import keeps_contract, law, refused


def check_linear_solver(solver: LinearSolver, seed: int = 0, trials: int = 5) -> None:
    """Laws of a linear solver: solutions and statuses on random matrices of 1 to 200 unknowns.

    Matrices of conduction and of spring lattices, of any scale, with one right-hand side or
    several, with and without dof locations (`places`): repeated solves agree bit by bit, arguments
    stay unchanged, and an initial guess helps or does no harm. A singular or not finite matrix must
    not be reported as solved, an indefinite one only with a correct solution; one that is not
    square or not symmetric raises InputError.
    """
    keeps_contract("linear_solver", solver)
    for trial in range(trials):
        rng = np.random.default_rng([seed, trial])
        for make in (random_heat, random_lattice):
            A, places = make(rng)
            where = f"({make.__name__}, {A.shape[0]} unknowns, seed {seed}, trial {trial})"
            _solves(solver, A, places, rng, where)
            _solves(solver, A, None, rng, f"without places {where}")
    rng = np.random.default_rng(seed)
    _owns_up(solver, rng)
    _refuses(solver, rng)


def random_heat(rng: np.random.Generator) -> tuple[Csr, DofLocations]:
    """Random matrix of transient conduction (capacity over step size plus conduction on a graph of
    points, in the plane or in space), and its dof locations."""
    n, d = int(rng.integers(1, 200)), int(rng.integers(2, 4))
    L = _graph(n, rng)
    scale = 10.0 ** rng.uniform(-9.0, 9.0)
    A = scale * (L + 10.0 ** rng.uniform(-3.0, 1.0) * sparse.eye_array(n))
    return sparse.csr_array(A), DofLocations(rng.random((n, d)), np.zeros(n, dtype=np.int64))


def random_lattice(rng: np.random.Generator) -> tuple[Csr, DofLocations]:
    """Random stiffness matrix of a box of springs along edges and diagonals, one face fixed, some
    components left out, and its dof locations."""
    d = int(rng.integers(2, 4))
    shape = rng.integers(2, 5, d)
    X = np.stack(np.meshgrid(*[np.arange(k) for k in shape], indexing="ij"), axis=-1)
    X = X.reshape(-1, d) + 0.2 * rng.random((int(np.prod(shape)), d))
    gaps = np.linalg.norm(X[:, None] - X[None], axis=2)
    i, j = np.nonzero(np.triu(gaps < 1.9, 1))
    along = (X[j] - X[i]) / gaps[i, j][:, None]
    # a row of B: elongation of a spring by the displacements, times the root of its stiffness
    B = np.zeros((len(i), len(X), d))
    B[np.arange(len(i)), i], B[np.arange(len(i)), j] = -along, along
    B = B.reshape(len(i), -1) * np.sqrt(10.0 ** rng.uniform(0.0, 1.0, len(i)))[:, None]
    held = np.repeat(X[:, 0] < 0.5, d)
    free = np.flatnonzero(~held & (rng.random(held.size) < 0.9))
    free = free if free.size else np.flatnonzero(~held)
    K = 10.0 ** rng.uniform(0.0, 11.0) * (B.T @ B + 1e-3 * np.eye(B.shape[1]))
    A = sparse.csr_array(K[np.ix_(free, free)])
    return A, DofLocations(X[free // d], free % d)


def _graph(n: int, rng: np.random.Generator) -> Csr:
    """Laplacian (n, n) of a random connected graph; constant vectors are its kernel."""
    chain = np.arange(n - 1)
    i = np.concatenate([chain, rng.integers(0, n, n)])
    j = np.concatenate([chain + 1, rng.integers(0, n, n)])
    w = np.where(i == j, 0.0, 0.1 + rng.random(len(i)))
    W = sparse.coo_array((w, (i, j)), shape=(n, n)).tocsr()
    W = W + W.T
    return sparse.csr_array(sparse.diags_array(np.asarray(W.sum(axis=1))) - W)


def _solves(
    solver: LinearSolver, A: Csr, places: DofLocations | None, rng: np.random.Generator, where: str
) -> None:
    """Checks solutions against a dense solver, for one and several right-hand sides, and that
    nothing is written to A and b."""
    n, before = A.shape[0], A.copy()
    done, again = solver.factorize(A, places), solver.factorize(A, places)
    law(done.status is Status.DONE, f"factorized with {done.status.value}, {done.note}: {where}")
    law(done.solver and isinstance(done.memory, int) and done.memory >= 0,
        f"solver {done.solver!r} and memory {done.memory!r} must be a name and bytes: {where}")
    law(isinstance(done.iterative, bool), f"`iterative` must be True or False: {where}")
    for b in (rng.standard_normal(n), 1e6 * rng.standard_normal((n, 3)), np.zeros(n),
              np.zeros((n, 0)), np.asfortranarray(rng.standard_normal((n, 2)))):
        what = f"b {b.shape} {where}"
        kept = b.copy()
        outcome = done.outcome(b)
        law(np.array_equal(b, kept), f"the solver wrote to b: {what}")
        _honest(A, b, outcome, what)
        law(outcome.status is Status.DONE, f"ended with {outcome.status.value}: {what}")
        true = np.linalg.solve(A.toarray(), b)
        error = np.linalg.norm(outcome.x - true) / max(float(np.linalg.norm(true)), 1e-300)
        law(error < 1e-5, f"x has a relative error of {error:.1e}: {what}")
        law(np.array_equal(done.solve(b), again.solve(b)), f"two solves differ: {what}")
        law(np.array_equal(done.solve(b), outcome.x), f"solve and outcome differ: {what}")
        _starts(done, A, b, true, rng, what)
    law((abs(A - before)).sum() == 0.0, f"the solver wrote to A: {where}")


def _starts(
    done: Factorized, A: Csr, b: FloatArray, true: FloatArray, rng: np.random.Generator, what: str
) -> None:
    """Checks initial guesses: the solution must cost no more iterations than zero, and a random
    guess must lead to a solution, too."""
    for start, name in ((true, "the solution"), (rng.standard_normal(b.shape), "a random one")):
        kept = start.copy()
        outcome = done.outcome(b, start)
        law(np.array_equal(start, kept), f"the solver wrote to its start: {what}")
        law(outcome.status is Status.DONE, f"start {name}: {outcome.status.value}: {what}")
        _honest(A, b, outcome, f"start {name}, {what}")
        law(np.array_equal(done.solve(b, start), outcome.x), f"solve differs, start {name}: {what}")
    cold, warm = done.outcome(b), done.outcome(b, true)
    law(done.iterative or cold.iterations == 0, f"a direct solver that iterates: {what}")
    law(warm.iterations <= cold.iterations,
        f"{warm.iterations} iterations from the solution, {cold.iterations} from zero: {what}")


def _honest(A: Csr, b: FloatArray, outcome: LinearOutcome, what: str) -> None:
    law(outcome.x.shape == b.shape, f"x has shape {outcome.x.shape}, not {b.shape}: {what}")
    left = float(relative_residuals(A, outcome.x.reshape(len(b), -1), b.reshape(len(b), -1)).max(
        initial=0.0))
    law(abs(left - outcome.residual) <= 1e-3 * left + 1e-13,
        f"the residual is said to be {outcome.residual:.2e}, it is {left:.2e}: {what}")
    law(outcome.residual <= 1e-6 or not outcome.status.ok,
        f"solved with a residual of {outcome.residual:.1e}: {what}")


def _owns_up(solver: LinearSolver, rng: np.random.Generator) -> None:
    """Checks that failures are reported by a status, and that no numbers are returned as a
    solution."""
    n = 40
    L = _graph(n, rng)
    good = sparse.csr_array(L + sparse.eye_array(n))
    nan = good.copy()
    nan.data = nan.data.copy()
    nan.data[3] = np.nan
    zero = good.tolil()
    zero[5, :] = 0.0
    zero[:, 5] = 0.0
    cases = {"a singular matrix": L, "a row of zeros": sparse.csr_array(zero), "nan in A": nan,
             "an indefinite matrix": sparse.csr_array(L - 0.1 * sparse.eye_array(n))}
    b = 1.0 + rng.random(n)
    for name, A in cases.items():
        done = solver.factorize(A)
        outcome = done.outcome(b)
        if outcome.status.ok:  # an indefinite system may be solved; it must be, then
            law(name == "an indefinite matrix", f"{name} was reported as solved")
            _honest(A, b, outcome, name)
        else:
            law(not np.isfinite(done.solve(b)).all(), f"{name}: solve gives numbers for a failure")
        if not done.status.ok:
            law(bool(done.note), f"{name}: the note of a failed factorization is empty")
    b[7] = np.nan
    outcome = solver.factorize(good).outcome(b)
    law(not outcome.status.ok, f"nan in b ended with {outcome.status.value}")


def _refuses(solver: LinearSolver, rng: np.random.Generator) -> None:
    """Checks that matrices that are not square or symmetric, and right-hand sides of another
    length, are refused."""
    n = 30
    good = sparse.csr_array(_graph(n, rng) + sparse.eye_array(n))
    skew = good.tolil()
    skew[2, 20] = 0.7
    done = solver.factorize(good)
    tries: dict[str, Callable[[], object]] = {
        "a matrix that is not square": lambda: solver.factorize(good[:-1]),
        "a matrix that is not symmetric": lambda: solver.factorize(sparse.csr_array(skew)),
        "a right-hand side of wrong length": lambda: done.solve(np.ones(n + 1)),
    }
    for name, attempt in tries.items():
        refused(name, attempt)
