"""Weights of the elements of one block, trained so that few of them do the work of all.

The unknown weights w >= 0 of the E elements are to repeat, at the training snapshots projected on
the atoms, the projected forces that all elements give with weight 1: G w = G 1, one row of G for
each atom and snapshot (Farhat, Avery, Chapman, Cortial 2014, doi 10.1002/nme.4668, Eq. 15-19).

Forces of elements are linear in the unknowns here, so 4000 snapshots are first replaced by the few
combinations of them that have the same products (a QR factorisation, exact), and those in turn by
the few that matter (`Equations.compressed`). Rows are measured by
what they do: elastic forces by the displacement they cause in K, heat by the rate of temperature
it causes in C. Without that the stiff atoms take all the attention, and the elastic error was ten
times larger with as many elements.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from sparsemor.core import (
    Dictionary,
    ElasticIntegrals,
    FloatArray,
    HeatIntegrals,
    IntArray,
    Integrals,
    WeighsElements,
    column_chunks,
)
from sparsemor.reducers.projection.ecsw.nnls import Weights, nonnegative
from sparsemor.reducers.projection.ecsw.training_matrix import Equations, Part, Rows

LEFT_OUT = (1e-2, 1e-3, 1e-4)
"""Singular values of G, as shares of tau, below which a direction is left out: tried in turn."""
MET = 1.05
"""Where tau counts as met, as a multiple of it."""
CANDIDATES = 20_000
"""Elements of a larger mesh among which weights are sought, drawn at random: it bounds the
memory and time of training. The forces to be reproduced are those of all elements."""


@dataclass(frozen=True, slots=True, eq=False)
class Trained:
    """Training coefficients of one block: c (k, M) at times t (M,), s."""

    dictionary: Dictionary
    c: FloatArray
    t: FloatArray

    @classmethod
    def of(cls, dictionary: Dictionary, snapshots: FloatArray, t: FloatArray) -> "Trained":
        """From snapshots (n, M): their least-squares projection on the atoms."""
        inverse = np.linalg.pinv(dictionary.atoms)
        c = [inverse @ (part - dictionary.offset[:, None]) for _, part in column_chunks(snapshots)]
        return cls(dictionary, np.asarray(np.concatenate(c, axis=1), dtype=np.float64), t)

    @property
    def with_offset(self) -> FloatArray:
        """(n, k + 1): the atoms and the offset, which the last of `homogeneous` multiplies."""
        return np.column_stack([self.dictionary.atoms, self.dictionary.offset])

    @property
    def homogeneous(self) -> FloatArray:
        """(k + 1, M): coefficients and a row of ones."""
        return np.vstack([self.c, np.ones(len(self.t))])

    def rates(self) -> FloatArray:
        """(k, M'): difference quotients of neighbouring snapshots, those that follow in time."""
        dt = np.diff(self.t)
        on = dt > 0.0
        return np.asarray(np.diff(self.c, axis=1)[:, on] / dt[on])

    def rates_at(self) -> FloatArray:
        """(k, M): the difference quotient that ends at each snapshot; at the start, and at an
        extra snapshot made there, the one that begins there. Zero for a single time."""
        ends = np.flatnonzero(np.diff(self.t) > 0.0) + 1
        found = np.zeros_like(self.c)
        if len(ends):
            quotients = self.rates()
            found[:] = quotients[:, :1]
            found[:, ends] = quotients
        return found


def elastic_equations(
    integrals: ElasticIntegrals, u: Trained, heat: Trained | None, flexibility: FloatArray
) -> Equations:
    """G (m, E): static displacements that stiffness and thermal forces cause, as shares of |c|.

    flexibility (k, k): inverse of the projected stiffness. Both parts are trained, not only their
    sum, which is small: it would be met by a body that is neither stiff nor expands.
    """
    count, size = integrals.stiffness.count, float(np.linalg.norm(u.c))
    if size == 0.0:
        return Equations(count, (), ())
    left = u.dictionary.atoms @ flexibility.T / size
    prescribed = _values_at(integrals.amplitudes, u.t)
    thermal, factors = [(integrals.given, np.eye(len(prescribed)))], [prescribed]
    if integrals.coupling is not None and heat is not None:
        thermal.append((integrals.coupling, heat.with_offset))
        factors.append(heat.homogeneous)
    return _equations(count, [
        (left, [(integrals.stiffness, u.with_offset)], u.homogeneous, None),
        (left, thermal, np.concatenate(factors), None)])


def heat_equations(integrals: HeatIntegrals, T: Trained, inertness: FloatArray) -> Equations:
    """G (m, E): rates of temperature that conduction and changes of heat cause, each as a share of
    its own. inertness (k, k): inverse of the projected capacity."""
    left = T.dictionary.atoms @ inertness.T
    prescribed = _values_at(integrals.amplitudes, T.t)
    # what conduction and changes are differences of: below its round-off there is nothing to learn
    top = np.abs(T.with_offset) @ np.abs(T.homogeneous).max(axis=1)
    K = abs(integrals.conductivity.weighted(np.ones(integrals.conductivity.count)))
    flow = float(np.linalg.norm(np.abs(left).T @ (K @ top)))
    change = float(np.linalg.norm(np.abs(T.c).max(axis=1))) / float(np.abs(np.diff(T.t)).max())
    conduction = [(integrals.conductivity, T.with_offset),
                  (integrals.given, -np.eye(len(prescribed)))]
    return _equations(integrals.capacity.count, [
        (left, conduction, np.concatenate([T.homogeneous, prescribed]), flow),
        (left, [(integrals.capacity, T.dictionary.atoms)], T.rates(), change)])


def local_equations(
    term: WeighsElements, left: FloatArray, x: FloatArray, v: FloatArray, t: FloatArray
) -> Equations:
    """G (m, F) of a local term: left (k, m) times each element's share at states x (n, M) and
    rates v (n, M)."""
    shares = term.contributions(left, x, v, t)
    return Equations.of(shares.reshape(len(shares), -1).T, float(np.abs(shares).sum()))


def _values_at(amplitudes: Sequence[Callable[[float], float]], t: FloatArray) -> FloatArray:
    """(1 + j, M): ones, and prescribed functions of time."""
    values = [[f(float(s)) for s in t] for f in amplitudes]
    return np.array([np.ones(len(t)), *values])


Shares = tuple[FloatArray, Sequence[tuple[Integrals, FloatArray]], FloatArray, float | None]
"""Rows of G: left (n, k); integrals with what they are applied to, side by side (m, z); what that
is multiplied by at the snapshots (z, M); and what their sum is made of (see `Rows`)."""


def _equations(count: int, shares: Sequence[Shares]) -> Equations:
    parts, content = [], list[object]()
    for left, pairs, factors, against in shares:
        # r <= z combinations in place of M columns
        few = np.asarray(np.linalg.qr(factors.T, mode="r")).T
        parts.append(Rows(left.shape[1] * few.shape[1], partial(_made, left, pairs, few), against))
        content += [left, few, against]
        content += [a for g, right in pairs for a in (g.rows, g.columns, g.values, right)]
    return Equations(count, tuple(parts), tuple(content))


def _made(
    left: FloatArray, pairs: Sequence[tuple[Integrals, FloatArray]], few: FloatArray, part: Part
) -> FloatArray:
    """(k r, E'): the columns of some elements."""
    tensor = np.concatenate([g.part(part).projected(left, right) for g, right in pairs], axis=2)
    return np.ascontiguousarray((tensor @ few).reshape(len(tensor), -1).T)


def train(equations: Equations, tau: float) -> Weights:
    """w (E,) >= 0 with |G w - G 1| <= tau, few of them not zero; all 1 where G has no rows.

    Directions in which all elements together cannot differ by what matters are left out; where few
    weights of a large mesh, which are large, made more of them, fewer are left out.
    """
    G = equations.scaled().fewer()
    if not G.parts:
        return Weights(np.ones(G.count), 0.0)
    total, among, few = G.total(), candidates(G.count), G.mixed()
    b = few.total()
    size, U = few.directions(among, b, LEFT_OUT[-1] * tau)
    best = Weights(np.ones(G.count), np.inf)
    goal = 0.98 * tau  # a little less, for what is left out
    for share in LEFT_OUT:
        kept = U[:, size > share * tau]
        w = np.zeros(G.count)
        w[among] = nonnegative(few.along(kept, among), kept.T @ b, goal).values
        residual = float(np.linalg.norm(G.applied(w) - total))
        if residual < best.residual:
            best = Weights(w, residual)
        if best.residual <= MET * tau:
            break
        if few is not G:  # combinations of equations are met better than the equations
            goal *= tau / residual
    return best


def candidates(count: int) -> IntArray:
    """Numbers of the elements among which weights are sought, sorted: the same in every call."""
    if count <= CANDIDATES:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, CANDIDATES, replace=False))
