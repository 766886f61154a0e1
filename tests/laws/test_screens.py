"""The screen of greedy Gauss-Newton says what the solver would do, or that it cannot tell."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.protocols import Group, SparseStart
from sparsemor.core.screening import Screening, Tolerance
from sparsemor.plugins.sparse_solvers.greedy_gauss_newton import GreedyGaussNewton
from sparsemor.plugins.sparse_solvers.largest import Largest, largest, within
from sparsemor.plugins.sparse_solvers.normal import Columns, Everyone
from sparsemor.plugins.sparse_solvers.screen import LinearScreen


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """J c - b with two groups, and a support of full budgets with its least squares."""

    J: FloatArray
    b: FloatArray
    groups: tuple[Group, ...]
    support: BoolArray
    c: FloatArray
    needs: frozenset[str] = frozenset({"overdetermined"})

    @classmethod
    def drawn(cls, rng: np.random.Generator, m: int = 40) -> "Linear":
        """Neighbouring columns at a cosine near 0.8, so that exchanges are a matter of degree."""
        sizes, budgets = (14, 12), (4, 3)
        k = sum(sizes)
        J = rng.standard_normal((m, k))
        J += 1.5 * np.roll(J, 1, axis=1)
        J *= 10.0 ** rng.uniform(-1.0, 1.0, k)
        truth = np.where(rng.random(k) < 0.4, rng.standard_normal(k), 0.0)
        b = J @ (truth / np.linalg.norm(J, axis=0)) + 0.05 * rng.standard_normal(m)
        support, start, groups = np.zeros(k, dtype=np.bool_), 0, []
        for name, size, budget in zip("ab", sizes, budgets, strict=True):
            groups.append(Group(name, start, start + size, budget))
            support[start + rng.choice(size, budget, replace=False)] = True
            start += size
        c = np.zeros(k)
        c[support] = np.linalg.lstsq(J[:, support], b, rcond=None)[0]
        return cls(J, b, tuple(groups), support, c)

    def residual(self, c: FloatArray) -> FloatArray:
        return self.J @ c - self.b

    def jacobian(self, c: FloatArray) -> FloatArray:
        return self.J

    def screen(self, solver: GreedyGaussNewton) -> LinearScreen:
        return solver.screen(self.J, np.linalg.norm(self.J, axis=0), self.groups, len(self.J))


CLOSE = Tolerance(1e-9, 1e-9)
SOLVERS = [GreedyGaussNewton(candidates=who, growth=growth)
           for who in ("correlated", "all") for growth in (None, 1)]
NAMES = ["correlated", "correlated, one by one", "all", "all, one by one"]


@pytest.mark.parametrize("solver", SOLVERS, ids=NAMES)
def test_a_screen_settles_where_the_solver_ends(solver: GreedyGaussNewton) -> None:
    """From the support that the solver itself left, one that it would leave, and after a few
    exchanges; the residual is told at coefficients that are not yet the least squares."""
    told = stayed = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        problem = Linear.drawn(rng)
        screen = problem.screen(solver)
        for support in (problem.support, solver.solve(
                problem, SparseStart(problem.c, problem.support)).support):
            near = np.where(support, problem.c + 0.01 * rng.standard_normal(len(support)), 0.0)
            found = screen.settle(problem.residual(near), near, support, 0.0, CLOSE)
            if found is None:
                continue
            want = solver.solve(problem, SparseStart(near, support))
            assert want.status.ok
            np.testing.assert_array_equal(found, want.support, f"seed {seed}")
            told += 1
            stayed += found is support
            if screen.stays(problem.residual(near), near, support, 1e-9):
                assert found is support
    assert told >= 110, "of 120"
    assert 40 <= stayed < told


@pytest.mark.parametrize("solver", SOLVERS, ids=NAMES)
def test_a_refusal_that_stands_is_one(solver: GreedyGaussNewton) -> None:
    """A residual that wanders, asked of a screen that remembers and of one that was never asked."""
    stood = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        problem = Linear.drawn(rng)
        support = solver.solve(problem, SparseStart(problem.c, problem.support)).support
        screen, b = problem.screen(solver), problem.b
        for _ in range(40):
            b = b + 0.004 * np.linalg.norm(problem.b) * rng.standard_normal(len(b)) / len(b) ** 0.5
            c = np.zeros(len(support))
            c[support] = np.linalg.lstsq(problem.J[:, support], b, rcond=None)[0]
            r, new = problem.J @ c - b, problem.screen(solver)
            z = screen.norms * c
            stood += screen._refusals.stands(r, z, support, 0.0, solver.gain, CLOSE)
            found, want = (s.settle(r, c, support, 0.0, CLOSE) for s in (screen, new))
            assert (found is support) == (want is support)
            if found is not None and want is not None:
                np.testing.assert_array_equal(found, want)
    assert stood >= 100, "of 480"


def test_what_is_closer_than_the_tolerance_is_not_told() -> None:
    """With a tolerance that no decision can beat, only those that both ways agree on are told."""
    solver, untold = GreedyGaussNewton(candidates="all"), 0
    for seed in range(40):
        problem = Linear.drawn(np.random.default_rng(seed))
        screen = problem.screen(solver)
        r = problem.residual(problem.c)
        sure = screen.settle(r, problem.c, problem.support, 0.0, CLOSE)
        unsure = screen.settle(r, problem.c, problem.support, 0.0, Tolerance(0.2, 0.2))
        untold += unsure is None
        assert unsure is None or (sure is not None and np.array_equal(unsure, sure))
    assert untold >= 20


def test_a_residual_at_round_off_keeps_its_support() -> None:
    """As the solver does: what is left of an exact fit correlates with anything."""
    problem = Linear.drawn(np.random.default_rng(0))
    exact = replace(problem, b=problem.J @ problem.c)
    screen = exact.screen(GreedyGaussNewton())
    r = exact.residual(exact.c)
    assert np.linalg.norm(r) < 1e-13
    found = screen.settle(r, exact.c, exact.support, 0.0, CLOSE)
    assert found is exact.support
    # rounding in unknowns that were eliminated counts, too: here it hides an exchange that pays
    r = problem.residual(problem.c)
    screen = problem.screen(GreedyGaussNewton())
    better = screen.settle(r, problem.c, problem.support, 0.0, CLOSE)
    assert better is not None and not np.array_equal(better, problem.support)
    hidden = 1e14 * float(np.linalg.norm(r))
    assert screen.settle(r, problem.c, problem.support, hidden, CLOSE) is problem.support


def test_screens_of_another_jacobian_are_unlike() -> None:
    rng = np.random.default_rng(1)
    problem = Linear.drawn(rng)
    solver = GreedyGaussNewton(candidates="all")
    screen, r = problem.screen(solver), problem.residual(problem.c)
    assert screen.unlike(problem.screen(solver), r, problem.c, problem.support) == (0.0, 0.0)
    seen = []
    for change in (1e-6, 1e-4, 1e-2):
        moved = problem.J * (1.0 + change * rng.standard_normal(problem.J.shape))
        other = replace(problem, J=moved).screen(solver)
        seen.append(max(screen.unlike(other, r, problem.c, problem.support)))
    assert 1e-7 < seen[0] < seen[1] / 10 < seen[2] / 100
    assert isinstance(solver, Screening)


@pytest.mark.parametrize("seed", range(5))
def test_columns_held_at_zero_are_least_squares_without_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    J, r = rng.standard_normal((30, 12)), rng.standard_normal(30)
    J[:, 5] = 0.0
    seen = np.arange(12) != 5
    whole = Everyone.of(J, seen, 1e-12)
    assert whole is not None
    out = np.array([2, 5, 9])
    W = whole.holding(out)
    assert W is not None
    use = np.setdiff1d(np.arange(12), out)
    want = np.zeros(12)
    want[use] = np.linalg.lstsq(J[:, use], r, rcond=None)[0]
    np.testing.assert_allclose(W @ r, want, atol=1e-12)
    some = Columns.of(J, use, 1e-12)
    assert some is not None
    assert some.norm(r) == pytest.approx(np.linalg.norm(r - J @ want), rel=1e-12)
    assert some.norm(J[:, use] @ np.ones(len(use))) < 1e-12
    np.testing.assert_allclose(some.step(r), want[use], atol=1e-12)


def test_dependent_columns_have_no_screen() -> None:
    J = np.random.default_rng(0).standard_normal((10, 4))
    J[:, 3] = 2.0 * J[:, 1]
    assert Columns.of(J, np.arange(4), 1e-12) is None
    assert Everyone.of(J, np.ones(4, dtype=np.bool_), 1e-12) is None
    problem = Linear.drawn(np.random.default_rng(2))
    twins = problem.J.copy()
    first, second = np.flatnonzero(problem.support)[:2]
    twins[:, first] = twins[:, second]
    same = replace(problem, J=twins)
    for solver in SOLVERS:
        screen = same.screen(solver)
        assert screen.settle(same.residual(same.c), same.c, same.support, 0.0, CLOSE) is None


def test_the_largest_entries_and_how_sure_they_are() -> None:
    sizes = np.array([0.1, 5.0, 3.0, 2.9, 4.0, 0.0])
    (only,) = largest(sizes, 2, 1e-3)
    assert np.flatnonzero(only).tolist() == [1, 4]
    ways = largest(sizes, 3, 0.1)
    assert [np.flatnonzero(w).tolist() for w in ways] == [[1, 2, 4], [1, 3, 4]]
    assert largest(np.array([3.0, 2.9, 2.8, 0.1]), 1, 0.1) == []
    everyone = within(sizes, 5, 0.1)
    assert everyone is not None and np.flatnonzero(everyone[0]).tolist() == [0, 1, 2, 3, 4]
    groups = (Group("a", 0, 3, 1), Group("b", 3, 6, 2))
    chosen = np.array([False, True, False, True, True, False])
    order = Largest.of(chosen, groups)
    assert order is not None and order.holds(sizes, 1e-3)
    assert not order.holds(sizes, 1.0), "5 is not twice 3"
    assert Largest.of(np.zeros(6, dtype=np.bool_), groups) is None, "budgets not used up"
    among = Largest.among(chosen, sizes > 2.95, groups)
    assert among.holds(sizes, 0.5) and not among.holds(sizes, 0.7)
