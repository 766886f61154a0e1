"""The screen of greedy Gauss-Newton says what the solver would do, or that it cannot tell."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.protocols import Group, SparseStart
from sparsemor.core.protocols.sparse_solver import GramError, Quadratic, ScreensSupport
from sparsemor.plugins.sparse_solvers.gram import Move, Normal, Part, Swap, gathered
from sparsemor.plugins.sparse_solvers.greedy_gauss_newton import GreedyGaussNewton
from sparsemor.plugins.sparse_solvers.hard_thresholding import Largest, Tolerance, largest, within
from sparsemor.plugins.sparse_solvers.screen import ExchangeScreen
from tiers import quick

CLOSE = GramError(1e-9, 0.0)


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

    def screen(self, solver: GreedyGaussNewton) -> ExchangeScreen:
        return solver.screen(self.groups, self.J.any(axis=0), len(self.J))

    def around(
        self, c: FloatArray, error: GramError = CLOSE, hidden: float = 0.0,
        gram: FloatArray | None = None,
    ) -> Quadratic:
        """gram: that of an earlier question, where nothing changed in it."""
        lengths, r = np.linalg.norm(self.J, axis=0), self.residual(c)
        lengths[lengths == 0.0] = 1.0
        J = self.J / lengths
        gram = np.asfortranarray(J.T @ J) if gram is None else gram
        return Quadratic(gram, J.T @ r, lengths * c, np.ones(len(c)), error, None,
                         lambda: (float(r @ r), hidden))


SOLVERS = [GreedyGaussNewton(candidates=who, growth=growth, hysteresis=hysteresis)
           for hysteresis in (0.0, 0.3) for who in ("correlated", "all") for growth in (None, 1)]
NAMES = [f"{who}{what}" for what in ("", ", hysteresis") for who in (
    "correlated", "correlated, one by one", "all", "all, one by one")]


@pytest.mark.parametrize("solver", quick(SOLVERS, SOLVERS[0], SOLVERS[-1]), ids=NAMES)
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
            found = screen.settle(problem.around(near), support)
            if found is None:
                continue
            want = solver.solve(problem, SparseStart(near, support))
            assert want.status.ok
            np.testing.assert_array_equal(found, want.support, f"seed {seed}")
            told += 1
            stayed += found is support
            if screen.stays(problem.around(near), support):
                assert found is support
    assert told >= 110, "of 120"
    assert 40 <= stayed < told


@pytest.mark.parametrize("solver", quick(SOLVERS, SOLVERS[0], SOLVERS[-1]), ids=NAMES)
def test_a_refusal_that_stands_is_one(solver: GreedyGaussNewton) -> None:
    """A residual that wanders, asked of a screen that remembers and of one that was never asked."""
    stood = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        problem = Linear.drawn(rng)
        support = solver.solve(problem, SparseStart(problem.c, problem.support)).support
        screen, b, gram = problem.screen(solver), problem.b, None
        for _ in range(40):
            b = b + 0.004 * np.linalg.norm(problem.b) * rng.standard_normal(len(b)) / len(b) ** 0.5
            c = np.zeros(len(support))
            c[support] = np.linalg.lstsq(problem.J[:, support], b, rcond=None)[0]
            now, new = replace(problem, b=b), problem.screen(solver)
            at = now.around(c, gram=gram)
            gram = at.gram
            stood += screen.stands(at, support)
            found, want = screen.settle(at, support), new.settle(now.around(c), support)
            assert (found is support) == (want is support)
            if found is not None and want is not None:
                np.testing.assert_array_equal(found, want)
    assert stood >= 100 if solver.candidates == "all" else stood == 0, "of 480"


@pytest.mark.parametrize("solver", quick(SOLVERS, SOLVERS[0], SOLVERS[-1]), ids=NAMES)
def test_a_reason_that_holds_is_one(solver: GreedyGaussNewton) -> None:
    """Told once as functions of slope and c, it is asked of others than those it was told for."""
    asked = held = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        problem = Linear.drawn(rng)
        support = solver.solve(problem, SparseStart(problem.c, problem.support)).support
        screen, c = problem.screen(solver), np.zeros(len(support))
        c[support] = np.linalg.lstsq(problem.J[:, support], problem.b, rcond=None)[0]
        at = problem.around(c)
        why = screen.reason(at, support) if screen.stays(at, support) else None
        if why is None:
            continue
        assert [p.stop for p in why.parts][-1] == len(why.slope) == len(why.c)
        for size in (0.0, 0.003, 0.03):
            b = problem.b + size * np.linalg.norm(problem.b) * rng.standard_normal(
                len(problem.b)) / len(problem.b) ** 0.5
            c[support] = np.linalg.lstsq(problem.J[:, support], b, rcond=None)[0]
            new = replace(problem, b=b).around(c)
            asked += 1
            if why.holds(why.slope @ new.slope + why.c @ new.c, 1e-9, [1e-14] * len(why.parts)):
                held += 1
                assert problem.screen(solver).settle(new, support) is support
    assert asked >= 6 and 2 <= held <= asked


def test_an_exchange_that_no_choice_makes_worth_while() -> None:
    """All columns together lower the norm by less: the support stays whatever is chosen."""
    never_valid = 0
    for seed in range(40):
        problem = Linear.drawn(np.random.default_rng(seed))
        screen = problem.screen(SOLVERS[-2])
        at, everyone = problem.around(problem.c), np.ones(len(problem.c), dtype=np.bool_)
        base = np.linalg.norm(problem.residual(problem.c))
        best = np.linalg.norm(problem.residual(np.linalg.lstsq(problem.J, problem.b)[0]))
        for gain in (0.05, 0.3, 0.9):
            found = screen.fits.never_valid(at, problem.support, everyone, gain)
            assert found == bool(best > (1.0 - gain) * base)
            never_valid += found
        assert not screen.fits.never_valid(at, problem.support, everyone, 1e-8), "not worth asking"
    assert 5 <= never_valid <= 115


def test_what_is_closer_than_the_tolerance_is_not_told() -> None:
    """With a tolerance that no decision can beat, only those that both ways agree on are told."""
    solver, unavailable_resultants = GreedyGaussNewton(candidates="all"), 0
    for seed in range(40):
        problem = Linear.drawn(np.random.default_rng(seed))
        screen = problem.screen(solver)
        sure = screen.settle(problem.around(problem.c), problem.support)
        unsure = screen.settle(problem.around(problem.c, GramError(0.2, 0.1)), problem.support)
        unavailable_resultants += unsure is None
        assert unsure is None or (sure is not None and np.array_equal(unsure, sure))
        exact = problem.around(problem.c, GramError(0.2, 0.1))._replace(
            exact=lambda p=problem: p.around(p.c))
        told = screen.settle(exact, problem.support)
        assert (told is None) == (sure is None), "a second look where the first is not enough"
        assert told is None or sure is None or np.array_equal(told, sure)
    assert unavailable_resultants >= 20


def test_a_residual_at_round_off_keeps_its_support() -> None:
    """As the solver does: what is left of an exact fit correlates with anything."""
    problem = Linear.drawn(np.random.default_rng(0))
    exact = replace(problem, b=problem.J @ problem.c)
    screen = exact.screen(GreedyGaussNewton())
    assert np.linalg.norm(exact.residual(exact.c)) < 1e-13
    assert screen.settle(exact.around(exact.c), exact.support) is exact.support
    # rounding in unknowns that were eliminated counts, too: here it hides an exchange that pays
    screen = problem.screen(GreedyGaussNewton())
    better = screen.settle(problem.around(problem.c), problem.support)
    assert better is not None and not np.array_equal(better, problem.support)
    hidden = (1e14 * float(np.linalg.norm(problem.residual(problem.c)))) ** 2
    found = screen.settle(problem.around(problem.c, hidden=hidden), problem.support)
    assert found is problem.support


@pytest.mark.parametrize("candidates", ["correlated", "all"])
def test_how_unlike_another_jacobian_is(candidates: str) -> None:
    rng = np.random.default_rng(1)
    problem = Linear.drawn(rng)
    solver = GreedyGaussNewton(candidates=candidates)
    screen, at = problem.screen(solver), problem.around(problem.c, GramError(1e-3, 1e-7))
    assert max(screen.unlike(at, at, problem.support)) < 1e-12
    seen = []
    for change in (1e-6, 1e-4, 1e-2):
        moved = problem.J * (1.0 + change * rng.standard_normal(problem.J.shape))
        other = replace(problem, J=moved).around(problem.c, GramError(1e-3, 1e-7))
        seen.append(screen.unlike(other, at, problem.support))
    for kind in zip(*seen, strict=True):
        assert 1e-8 < kind[0] < kind[1] / 10 < kind[2] / 100
    assert isinstance(solver, ScreensSupport)


@pytest.mark.parametrize("seed", range(5))
def test_least_squares_by_their_gram_matrix(seed: int) -> None:
    """Of some columns, and what an exchange does to the squared norm."""
    rng = np.random.default_rng(seed)
    J, r, c = rng.standard_normal((30, 12)), rng.standard_normal(30), np.zeros(12)
    gram = np.asfortranarray(np.triu(J.T @ J))
    old, new = np.zeros((2, 12), dtype=np.bool_)
    old[[1, 4, 7, 8]] = new[[1, 3, 8, 11]] = True
    c[old] = rng.standard_normal(4)
    for columns in (np.flatnonzero(old), np.arange(12)):
        part = Part.of(columns, 12)
        some = Normal.of(gram if part.flat is None else gathered(gram, part.flat).T, False)
        assert some is not None
        want = np.linalg.lstsq(J[:, columns], r, rcond=None)[0]
        for _ in range(4):  # the inverse is made on the way
            found = some.solve(J[:, columns].T @ r)
            np.testing.assert_allclose(found, want, atol=1e-12)
        assert some.inverse is not None and 0.0 < some.rounding(want) < 1e-12
    move = Move.of(gram, Swap.of(old, new))
    assert move is not None
    at = Quadratic(gram, J.T @ r, c, np.ones(12), GramError(0.0, 1e-9), None, lambda: (0.0, 0.0))
    start = r - J @ c  # residual(d) = r + J (d - c)
    least = start + J[:, new] @ np.linalg.lstsq(J[:, new], -start, rcond=None)[0]
    rise, error = move.rise(at)
    assert rise == pytest.approx(least @ least - r @ r, rel=1e-10)
    assert 1e-11 < error < 1e-7


def test_dependent_columns_have_no_screen() -> None:
    J = np.random.default_rng(0).standard_normal((10, 4))
    J[:, 3] = 2.0 * J[:, 1]
    assert Normal.of(np.asfortranarray(J.T @ J), False) is None
    problem = Linear.drawn(np.random.default_rng(2))
    twins = problem.J.copy()
    first, second = np.flatnonzero(problem.support)[:2]
    twins[:, first] = twins[:, second]
    same = replace(problem, J=twins)
    for solver in SOLVERS:
        assert same.screen(solver).settle(same.around(same.c), same.support) is None


def test_columns_of_zeros_are_left_out() -> None:
    """As the solver does."""
    solver, problem = GreedyGaussNewton(candidates="all"), Linear.drawn(np.random.default_rng(2))
    J, c = problem.J.copy(), problem.c.copy()
    unseen = np.flatnonzero(~problem.support)[::4]
    J[:, unseen] = 0.0
    blind = replace(problem, J=J)
    found = blind.screen(solver).settle(blind.around(c), blind.support)
    want = solver.solve(blind, SparseStart(c, blind.support)).support
    assert found is not None and not found[unseen].any()
    np.testing.assert_array_equal(found, want)


def test_the_largest_entries_and_how_sure_they_are() -> None:
    sizes = np.array([0.1, 5.0, 3.0, 2.9, 4.0, 0.0])
    (only,) = largest(sizes, 2, Tolerance(1e-3))
    assert np.flatnonzero(only).tolist() == [1, 4]
    ways = largest(sizes, 3, Tolerance(0.1))
    assert [np.flatnonzero(w).tolist() for w in ways] == [[1, 2, 4], [1, 3, 4]]
    assert largest(np.array([3.0, 2.9, 2.8, 0.1]), 1, Tolerance(0.1)) == []
    everyone = within(sizes, 5, Tolerance(0.1))
    assert everyone is not None and np.flatnonzero(everyone[0]).tolist() == [0, 1, 2, 3, 4]
    groups = (Group("a", 0, 3, 1), Group("b", 3, 6, 2))
    chosen = np.array([False, True, False, True, True, False])
    order = Largest.of(chosen, groups)
    assert order is not None and order.holds(sizes, Tolerance(1e-3))
    assert not order.holds(sizes, Tolerance(1.0)), "5 is not twice 3"
    assert not order.holds(sizes, Tolerance(0.0, 2.5)), "nor 3 by 2.5 more than 2.9"
    assert Largest.of(np.zeros(6, dtype=np.bool_), groups) is None, "budgets not used up"
    among = Largest.among(chosen, sizes > 2.95, groups)
    assert among.holds(sizes, Tolerance(0.5)) and not among.holds(sizes, Tolerance(0.7))
