"""Terms that are not linear in the unknowns of their block, such as radiation and conductivity that
depends on temperature, at states of the training run: their forces, and their tangent.

`local` terms are those evaluated element by element (core/protocols/separable.py); of the unknowns
that they read, those marked `hot` are temperatures, the others displacements."""

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array, csr_array

from sparsemor.core import Csr, Dictionary, FloatArray, IntArray, ReducedProblem
from sparsemor.core.protocols.separable import ElasticLocal, HeatBody, MovingBody
from sparsemor.reducers.estimation.error_space import Operators

ROUND_OFF = 1e-9
"""Change of a tangent, relative to its largest entry, up to which it counts as constant."""
STATES = 40
"""Number of snapshots at which forces are evaluated."""


class ElementForces:
    """Local terms of the blocks of a model at snapshots of its training run; without training, at
    the initial state."""

    def __init__(self, problem: ReducedProblem) -> None:
        self.model, self.offline = problem.model, problem.offline

    def _states(self, name: str) -> FloatArray:
        """States (n, M) of a block: the initial one, then snapshots."""
        x = self.model.x0[self.model.layout[name]][:, None]
        if not self.offline.trained:
            return x
        known = self.offline.snapshots(name)
        chosen = np.unique(np.linspace(0, known.shape[1] - 1, STATES).astype(int))
        return np.hstack([x, known[:, chosen]])

    def of_heat(self, b: HeatBody, d: Dictionary) -> FloatArray:
        """Forces (n, 2 M) of the local terms of a thermal block with atoms d: at its M states
        without rates, then what rates add to them there. Rates are the change to the next state, as
        a direction, and at the last state the first atom. No columns without local terms. Time in
        them is 0."""
        if not b.local:
            return np.zeros((len(d.offset), 0))
        T, start = self._states(b.thermal), self.model.layout[b.thermal].start
        rates = np.hstack([np.diff(T, axis=1), d.atoms[:, :1]])
        found = np.zeros((2, *T.shape))  # at zero rates, and with rates
        for term in b.local:
            rows, at = term.rows - start, term.columns - start
            zero = np.zeros(len(at))
            for i, (x, v) in enumerate(zip(T.T, rates.T, strict=True)):
                found[0][rows, i] += term.residual(x[at], zero, zero, 0.0)
                found[1][rows, i] += term.residual(x[at], v[at], zero, 0.0)
        return np.hstack([found[0], found[1] - found[0]])

    def tangent_of_heat(self, b: HeatBody) -> Operators:
        """Operators of a thermal block with the tangent of its local terms at the state in the
        middle of training: dr/dT adds to the conductivity, dr/dT' to the capacity."""
        constant = Operators.from_body(b)
        if not b.local:
            return constant
        T, start = self._states(b.thermal), self.model.layout[b.thermal].start
        x, K, C = T[:, T.shape[1] // 2], constant.stiffness, constant.damping
        for term in b.local:
            at = term.columns - start
            zero, one = np.zeros(len(at)), np.ones(len(at))
            # Jacobians for dT' = c1 dT with c1 = 0 and c1 = 1
            at_rest, changing = (
                _placed(term.jacobian(x[at], zero, zero, 0.0, c1, zero), term.rows - start, at,
                        K.shape[0]) for c1 in (zero, one))
            K, C = K + at_rest, C + (changing - at_rest)
        return replace(constant, stiffness=csr_array(K), damping=csr_array(C))

    def _displacements_and_temperatures(self, m: MovingBody) -> tuple[FloatArray, FloatArray]:
        """States (n, M) and (nT, M) of a body's displacements and temperatures; nT is 0 without
        these."""
        u = self._states(m.elastic)
        hot = m.thermal in self.model.layout
        return u, self._states(m.thermal) if hot else np.zeros((0, u.shape[1]))

    def of_elastic(self, m: MovingBody, d: Dictionary) -> FloatArray:
        """Forces (n, M) of the local terms of an elastic block at its M states, without rates and
        at time 0; no columns without local terms. d: trial basis of the block."""
        assert m.operators is not None
        if not m.operators.local:
            return np.zeros((len(d.offset), 0))
        u, T = self._displacements_and_temperatures(m)
        found = np.zeros(u.shape)
        for part in m.operators.local:
            for i in range(u.shape[1]):
                x = _read(part, u[:, i], T[:, i])
                zero = np.zeros(len(x))
                found[part.rows, i] += part.term.residual(x, zero, zero, 0.0)
        return found

    def tangent_of_elastic(self, m: MovingBody) -> Operators:
        """Operators of an elastic block with the tangent of its local terms, by displacements
        alone, at the state in the middle of training."""
        assert m.operators is not None
        constant, (u, T) = Operators.from_body(m.operators), self._displacements_and_temperatures(m)
        K, i = constant.stiffness, u.shape[1] // 2
        for part in m.operators.local:
            x = _read(part, u[:, i], T[:, i])
            zero = np.zeros(len(x))
            elastic = ~part.hot
            J = csr_array(part.term.jacobian(x, zero, zero, 0.0, zero, zero))[:, elastic]
            K = K + _placed(J, part.rows, part.columns[elastic], K.shape[0])
        return replace(constant, stiffness=csr_array(K))

    def has_nonlinear_stiffness(self, m: MovingBody) -> bool:
        """True if a local term of an elastic block is not linear in its displacements: its tangent
        changes from the initial state to one displaced by 1 mm."""
        if m.operators is None:
            return False
        u, T = self._displacements_and_temperatures(m)
        # 1 mm with other values at all nodes, so that all elements are strained, and reproducible
        displaced = u[:, 0] + 1e-3 * np.sin(np.arange(len(u)))
        for part in m.operators.local:
            if part.hot.all():  # it reads temperatures alone
                continue
            zero = np.zeros(len(part.columns))
            initial, other = (
                csr_array(part.term.jacobian(_read(part, x, T[:, 0]), zero, zero, 0.0, zero, zero))
                [:, ~part.hot] for x in (u[:, 0], displaced))
            if abs(other - initial).max() > ROUND_OFF * max(abs(initial).max(), abs(other).max()):
                return True
        return False


def _read(part: ElasticLocal, u: FloatArray, T: FloatArray) -> FloatArray:
    """Values that a local term reads, from displacements u and temperatures T of its body."""
    x = np.empty(len(part.columns))
    x[part.hot], x[~part.hot] = T[part.columns[part.hot]], u[part.columns[~part.hot]]
    return x


def _placed(J: Csr, rows: IntArray, columns: IntArray, n: int) -> Csr:
    """The symmetric part of a matrix of some rows and columns in all n rows and columns of the
    block, which linear solvers require."""
    found = coo_array(J)
    wide = csr_array((found.data, (rows[found.row], columns[found.col])), shape=(n, n))
    return csr_array(0.5 * (wide + wide.T))
