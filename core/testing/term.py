"""Law kit of a term of the equations."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.step_amplitude import Substep, substep
from sparsemor.core.protocols.term import PointArrays, Term, Trial
from sparsemor.core.testing.random_inputs import law


@dataclass(frozen=True, slots=True, eq=False)
class _Point:
    """Random state at a term's columns: unknowns and rates (n,), time (s), and the slopes dv/dx,
    da/dx (n,)."""

    x: FloatArray
    v: FloatArray
    a: FloatArray
    t: float
    c1: FloatArray
    c2: FloatArray

    @classmethod
    def draw(
        cls, n: int, base: FloatArray, scale: float, same_rates: bool, rng: np.random.Generator
    ) -> "_Point":
        x, v, a = (scale * rng.standard_normal(n) for _ in range(3))
        c1, c2 = _factors(n, same_rates, rng)
        return cls(base + x, v, a, float(rng.random()), c1, c2)

    def at(self, columns: IntArray) -> "_Point":
        c = columns
        return _Point(self.x[c], self.v[c], self.a[c], self.t, self.c1[c], self.c2[c])

    def moved(self, d: FloatArray) -> "_Point":
        v, a = self.v + self.c1 * d, self.a + self.c2 * d
        return _Point(self.x + d, v, a, self.t, self.c1, self.c2)


def check_term(
    term: Term, rng: np.random.Generator, base: FloatArray | None = None, scale: float = 1.0,
    trials: int = 5, rtol: float = 1e-6, same_rates: bool = False,
) -> None:
    """Laws of a term of the equations: `restrict` (to some rows) and `compress` (projection, with
    its arrays if it has any) agree with the residual and the Jacobian, and the Jacobian agrees with
    central differences.

    Unknowns are drawn around `base` (n,) at the term's columns (zeros when left out), they and
    their rates with standard deviation `scale`: give both where random numbers are not admissible,
    such as temperatures below 0 K. same_rates: one c1 and one c2 for all columns, as an integrator
    gives to unknowns of one order; for terms whose columns are all of one order.
    """
    n, m = term.columns.size, term.rows.size
    law(term.columns.ndim == 1 and np.unique(term.columns).size == n, "columns must be distinct")
    law(term.rows.ndim == 1, "rows must be a 1-D array")
    law(term.elements >= 0, "elements must not be negative")
    around = np.zeros(n) if base is None else base
    for _ in range(trials):
        p = _Point.draw(n, around, scale, same_rates, rng)
        r, J = _evaluated(term, p, m, n)
        _differences(term, p, J, scale, rng, rtol)
        some = np.sort(rng.choice(m, int(rng.integers(0, m + 1)), replace=False))
        for keep in (some, some[::2], some[:0], np.arange(m)):
            _restricted(term, p, r, J, keep.astype(np.int64))
        _compressed(term, p, around, scale, same_rates, rng)


def _factors(n: int, same: bool, rng: np.random.Generator) -> FloatArray:
    return rng.uniform(0.5, 2.0, (2, 1 if same else n)).repeat(n if same else 1, axis=1)


def _residual(term: Term, p: _Point) -> FloatArray:
    return term.residual(p.x, p.v, p.a, p.t)


def _jacobian(term: Term, p: _Point) -> FloatArray:
    return np.asarray(term.jacobian(p.x, p.v, p.a, p.t, p.c1, p.c2).toarray())


def _evaluated(term: Term, p: _Point, m: int, n: int) -> tuple[FloatArray, FloatArray]:
    """Residual (m,) and Jacobian (m, n) of a term, checked for shape, finite values, unchanged
    arguments and repeatability."""
    before = [p.x.copy(), p.v.copy(), p.a.copy()]
    r, J = _residual(term, p).copy(), _jacobian(term, p)
    law(r.shape == (m,), f"the residual has shape {r.shape}, not ({m},)")
    law(J.shape == (m, n), f"the Jacobian has shape {J.shape}, not ({m}, {n})")
    law(np.isfinite(r).all() and np.isfinite(J).all(), "a value is not finite")
    same = all(np.array_equal(a, b) for a, b in zip(before, (p.x, p.v, p.a), strict=True))
    law(same, "the term wrote to its arguments")
    law(np.array_equal(r, _residual(term, p)), "two evaluations at one point differ")
    return r, J


def _differences(
    term: Term, p: _Point, J: FloatArray, scale: float, rng: np.random.Generator, rtol: float
) -> None:
    """Checks the Jacobian in one random direction: a wrong entry shows in it with probability
    one."""
    d = rng.standard_normal(p.x.size)
    step = 1e-5 * scale
    ahead, behind = _residual(term, p.moved(step * d)), _residual(term, p.moved(-step * d))
    got, want = J @ d, (ahead - behind) / (2.0 * step)
    size = np.abs(want).max(initial=0.0)
    noise = 50.0 * np.finfo(np.float64).eps * np.abs(ahead).max(initial=0.0) / step
    error = np.abs(got - want).max(initial=0.0)
    law(error <= rtol * size + noise,
        f"Jacobian and central difference differ by {error:.2e} of {size:.2e}")


def _restricted(term: Term, p: _Point, r: FloatArray, J: FloatArray, keep: IntArray) -> None:
    """Checks `restrict`: residual and Jacobian of some rows are those rows of the whole term."""
    small, what = term.restrict(keep), f"restrict to {keep.size} of {term.rows.size} rows"
    law(np.array_equal(small.rows, term.rows[keep]), f"{what}: rows must be rows[keep]")
    place = {int(c): i for i, c in enumerate(term.columns)}
    law(all(int(c) in place for c in small.columns), f"{what}: its stencil has new columns")
    law(small.elements <= term.elements, f"{what}: more elements are visited than before")
    columns = np.array([place[int(c)] for c in small.columns], dtype=np.int64)
    q = p.at(columns)
    same = _close(_residual(small, q), r[keep], r)
    law(same, f"{what}: the residual differs from residual[keep]")
    wide = np.zeros((keep.size, p.x.size))
    wide[:, columns] = _jacobian(small, q)
    law(_close(wide, J[keep], J), f"{what}: the Jacobian differs from jacobian[keep]")


def _compressed(
    term: Term, p: _Point, base: FloatArray, scale: float, same_rates: bool,
    rng: np.random.Generator,
) -> None:
    """Checks `compress`: residual and Jacobian on a random basis are the projected ones of the
    term, and those of its functions on arrays the same."""
    n, m, k = p.x.size, term.rows.size, 3
    trial = Trial(rng.standard_normal((n, k)) / np.sqrt(k), base + 0.1 * p.a)
    left = rng.standard_normal((2, m))
    xi, xi1, xi2 = (scale * rng.standard_normal(k) for _ in range(3))
    c1, c2 = _factors(k, same_rates, rng)
    Z, reduced = trial.atoms, term.compress(trial, left)
    x, v, a, t = trial.offset + Z @ xi, Z @ xi1, Z @ xi2, p.t
    r = term.residual(x, v, a, t)
    size = np.abs(left) @ np.abs(r)
    got = reduced.residual(xi, xi1, xi2, t)
    law(got.shape == (2,), f"compress: the residual has shape {got.shape}, not (2,)")
    law(_close(got, left @ r, size), "compress: the residual differs from left @ residual")
    zero, one = np.zeros(n), np.ones(n)
    of_x = term.jacobian(x, v, a, t, zero, zero).toarray()
    of_v = term.jacobian(x, v, a, t, one, zero).toarray() - of_x
    of_a = term.jacobian(x, v, a, t, zero, one).toarray() - of_x
    J = of_x @ Z + of_v @ Z * c1 + of_a @ Z * c2
    slope = reduced.jacobian(xi, xi1, xi2, t, c1, c2)
    law(slope.shape == (2, k), f"compress: the Jacobian has shape {slope.shape}, not (2, {k})")
    terms = np.abs(left) @ (np.abs(of_x) + np.abs(of_v) + np.abs(of_a)) @ np.abs(Z)
    same = _close(slope, left @ J, terms)
    law(same, "compress: the Jacobian differs from left @ jacobian @ atoms")
    made = reduced.arrays()
    if made is not None:
        # arrays are those of steps of the size that the law was made for
        h = made.law.step
        if h:
            with substep(Substep(h)):
                got = reduced.residual(xi, xi1, 0.0 * xi1, t)
                slope = reduced.jacobian(xi, xi1, 0.0 * xi1, t, c1, c2)
            size = size + np.abs(got)
            terms = np.abs(slope) if terms.shape != slope.shape else terms + np.abs(slope)
        r_too, J_too = _by_arrays(made, xi, xi1, t, c1)
        law(_close(r_too, got, size), "the law on arrays differs from its residual")
        law(_close(J_too, slope, terms), "the law on arrays differs from its Jacobian")


def _by_arrays(
    a: PointArrays, x: FloatArray, v: FloatArray, t: float, c1: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Residual and Jacobian of a projected term from its arrays: fluxes y of a law at Q points of E
    elements, tested by the matrices `tests`. effects: of functions of time on z, with their values,
    rates and second differences (`bends`). reads: of each variable of the law its first row in z,
    its number of values per element, Q or 1, and 0, 1 or 2 for one of z, w and u; law.pairs: (flux
    i, variable j) of each derivative."""
    (E, Q), weights = a.weights.shape, a.weights.ravel()
    # z, w, u: values, rates and second differences of all variables
    z = a.P @ x + a.offset + a.effects @ np.array([f(t) for f in a.values])
    w = a.P @ v + a.effects @ np.array([f(t) for f in a.rates])
    # rows of z that each variable of the law reads at the E Q points
    at = [start + (np.arange(E * Q) if width == Q else np.repeat(np.arange(E), Q))
          for start, width, _ in a.reads.tolist()]
    u = a.effects @ np.array([f(t) for f in a.bends])
    values = np.array([(z, w, u)[kind][i] for i, kind in zip(at, a.reads[:, 2], strict=True)])
    y, slopes = np.zeros((len(a.tests), E * Q)), np.zeros((len(a.law.pairs), E * Q))
    gains = np.array([f(t) for f in a.law.amplitudes])
    a.law.function(a.law.numbers, gains, values, a.coordinates, y, slopes)
    tests = [L if L.shape[1] == E * Q else np.repeat(L, Q, axis=1) * weights for L in a.tests]
    r = sum(L @ flux for L, flux in zip(tests, y, strict=True))
    J = np.zeros((len(tests[0]), len(x)))
    for (i, j), slope in zip(a.law.pairs.tolist(), slopes, strict=True):
        J += (tests[i] * slope) @ a.P[at[j]] * (c1 if a.reads[j, 2] == 1 else 1.0)
    return np.asarray(r), J


def _close(a: FloatArray, b: FloatArray, scale: FloatArray) -> bool:
    """True if arrays are equal to 1e-9 of the largest number that entered them."""
    limit = 1e-9 * (np.abs(scale).max(initial=0.0) + np.abs(b).max(initial=0.0))
    return bool(a.shape == b.shape and np.abs(a - b).max(initial=0.0) <= limit)
