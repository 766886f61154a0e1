"""Weights of the elements of one block, trained so that few of them do the work of all.

The unknown weights w >= 0 of the E elements are to repeat, at the training snapshots projected on
the atoms, the projected forces that all elements give with weight 1: G w = G 1, one row of G for
each atom and snapshot (Farhat, Avery, Chapman, Cortial 2014, doi 10.1002/nme.4668, Eq. 15-19).

Forces of elements are linear in the unknowns here, so 4000 snapshots are first replaced by the few
combinations of them that have the same products (a QR factorisation, exact). Rows are measured by
what they do: elastic forces by the displacement they cause in K, heat by the rate of temperature
it causes in C. Without that the stiff atoms take all the attention, and the elastic error was ten
times larger with as many elements.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.integrals import ElasticIntegrals, HeatIntegrals, WeighedTerm
from sparsemor.core.protocols import Dictionary
from sparsemor.core.snapshots import stretches
from sparsemor.reducers.nnls import Weights, nonnegative

ROUND_OFF = 1e-11
"""Forces this much smaller than the sums that they are made of are what is left of rounding."""


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
        c = [inverse @ (part - dictionary.offset[:, None]) for _, part in stretches(snapshots)]
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


def elastic_equations(
    integrals: ElasticIntegrals, u: Trained, heat: Trained | None, flexibility: FloatArray
) -> FloatArray:
    """G (m, E): static displacements that stiffness and thermal forces cause, as shares of |c|.

    flexibility (k, k): inverse of the projected stiffness. Both parts are trained, not only their
    sum, which is small: it would be met by a body that is neither stiff nor expands.
    """
    A, L = u.dictionary.atoms, flexibility.T
    size = float(np.linalg.norm(u.c))
    if size == 0.0:
        return np.zeros((0, integrals.stiffness.count))
    known = _given(integrals.amplitudes, u.t)
    thermal, factors = [integrals.given.projected(A @ L, np.eye(len(known)))], [known]
    if integrals.coupling is not None and heat is not None:
        thermal.append(integrals.coupling.projected(A @ L, heat.with_offset))
        factors.append(heat.homogeneous)
    stiff = integrals.stiffness.projected(A @ L, u.with_offset)
    return np.concatenate([
        _rows(stiff, u.homogeneous) / size,
        _rows(np.concatenate(thermal, axis=2), np.concatenate(factors)) / size])


def heat_equations(integrals: HeatIntegrals, T: Trained, inertness: FloatArray) -> FloatArray:
    """G (m, E): rates of temperature that conduction and changes of heat cause, each as a share of
    its own. inertness (k, k): inverse of the projected capacity."""
    left = T.dictionary.atoms @ inertness.T
    known = _given(integrals.amplitudes, T.t)
    conduction = np.concatenate([
        integrals.conductivity.projected(left, T.with_offset),
        -integrals.given.projected(left, np.eye(len(known)))], axis=2)
    kept, rates = integrals.capacity.projected(left, T.dictionary.atoms), T.rates()
    # what conduction and changes are differences of: below its round-off there is nothing to learn
    top = np.abs(T.with_offset) @ np.abs(T.homogeneous).max(axis=1)
    K = abs(integrals.conductivity.weighted(np.ones(integrals.conductivity.count)))
    flow = float(np.linalg.norm(np.abs(left).T @ (K @ top)))
    change = float(np.linalg.norm(np.abs(T.c).max(axis=1))) / float(np.abs(np.diff(T.t)).max())
    return np.concatenate([
        _normalised(_rows(conduction, np.concatenate([T.homogeneous, known])), flow),
        _normalised(_rows(kept, rates), change)])


def local_equations(
    term: WeighedTerm, left: FloatArray, x: FloatArray, t: FloatArray
) -> FloatArray:
    """G (m, F) of a local term: left (k, m) times each element's share at states x (n, M)."""
    shares = term.contributions(left, x, t)
    G = shares.reshape(len(shares), -1).T
    return _normalised(G, float(np.abs(G).sum()))


def _given(amplitudes: Sequence[Callable[[float], float]], t: FloatArray) -> FloatArray:
    """(1 + j, M): ones, and known functions of time."""
    values = [[f(float(s)) for s in t] for f in amplitudes]
    return np.array([np.ones(len(t)), *values])


def _rows(tensor: FloatArray, factors: FloatArray) -> FloatArray:
    """(k r, E) from (E, k, z) and factors (z, M): r <= z combinations in place of M columns."""
    few = np.asarray(np.linalg.qr(factors.T, mode="r")).T
    return np.ascontiguousarray((tensor @ few).reshape(len(tensor), -1).T)


def _normalised(G: FloatArray, against: float) -> FloatArray:
    """G as a share of G 1; without rows where that is round-off of sums of size `against`."""
    size = float(np.linalg.norm(G.sum(axis=1)))
    if not size > ROUND_OFF * against:
        return np.zeros((0, G.shape[1]))
    return np.asarray(G / size)


def train(G: FloatArray, tau: float) -> Weights:
    """w (E,) >= 0 with |G w - G 1| <= tau, few of them not zero; all 1 where G has no rows."""
    E = G.shape[1]
    if not len(G):
        return Weights(np.ones(E), 0.0)
    if len(G) > 2 * E:
        G = np.asarray(np.linalg.qr(G, mode="r"))
    # directions in which all elements together cannot differ by what matters
    values, U = np.linalg.eigh(G @ G.T)
    A = U[:, values > (1e-2 * tau) ** 2].T @ G
    # a little less, for what was left out of A
    w = nonnegative(A, A.sum(axis=1), 0.98 * tau).values
    return Weights(w, float(np.linalg.norm(G @ (w - 1.0))))
