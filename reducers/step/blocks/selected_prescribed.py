"""Elastic block of a reduced model with prescribed frame motion of which few atoms of many are
active (notation: prescribed_frame_block.py)."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core import Amplitude, FloatArray, IntArray
from sparsemor.reducers.linalg.active_columns import ActiveColumns
from sparsemor.reducers.step.acceptance import EPS
from sparsemor.reducers.step.blocks.compressed_prescribed import ReducedPrescribed
from sparsemor.reducers.step.blocks.elastic_local import LocalForces, ReducedLocal
from sparsemor.reducers.step.blocks.prescribed_frame_block import Past
from sparsemor.reducers.step.operators import TestedElastic
from sparsemor.reducers.step.predictor import Prediction
from sparsemor.reducers.step.time_tables import Moving, tabulated


@dataclass(frozen=True, slots=True, eq=False)
class SelectedPrescribed(ReducedPrescribed):
    """Reduced block with s active of k atoms, where s is a small part of k.

    Its operators (s, k), D^-1 times mass, stiffness, damping, coupling and the M_g (`turning`), are
    computed only in the columns whose unknowns are not zero. With m sampled rows all columns would
    take s m k operations for each new support. G (g, s, s): D^-1 M_g in the active columns; sizes
    (g,): their Frobenius norms.
    """

    inertia: ActiveColumns
    stiffness: ActiveColumns
    damping: ActiveColumns | None
    coupling: ActiveColumns
    turning: tuple[ActiveColumns, ...]
    G: FloatArray
    sizes: FloatArray
    base: FloatArray
    E: FloatArray
    loads: FloatArray
    c1: float
    active: IntArray
    amplitudes: tuple[Amplitude, ...]
    tables: tuple[Moving, ...] = ()
    local: LocalForces | None = None

    @classmethod
    def of(
        cls, b: TestedElastic, left: FloatArray, support: IntArray, c1: float, c2: float
    ) -> "SelectedPrescribed":
        """Reduced block from the tested operators, whose columns are contiguous; left: see
        `CompressedPrescribed.of`."""
        s = len(left)
        G = np.array([left @ A[:, support] for A in b.generators]).reshape(
            len(b.generators), s, s)
        return cls(
            ActiveColumns(b.mass, -left), ActiveColumns(b.stiffness, -left),
            ActiveColumns(b.damping, -left) if b.damping.any() else None,
            ActiveColumns(b.coupling, left), tuple(ActiveColumns(A, left) for A in b.generators),
            G, np.linalg.norm(G, axis=(1, 2)), -left @ b.constant, -left @ b.directions,
            left @ b.loads, c1, support, b.amplitudes,
            tabulated(b.tables, left, False), ReducedLocal.of(b.local, left))

    def rates(self, k: int) -> tuple[FloatArray, FloatArray]:
        none = np.zeros((len(self.base), k))
        return none if self.damping is None else -self.damping.whole, -self.inertia.whole

    def bounds(self, kappa: FloatArray) -> FloatArray:
        return np.asarray(np.abs(kappa).dot(self.sizes))

    def begin(self, at: Prediction, c1: float, c2: float, table: FloatArray) -> Past:
        g = len(self.turning)
        past, n = Past(at, c1, c2, table, g), 2 * g + self.E.shape[1]
        past.bound, past.rest = float(table[n]), table[n + 1 :]
        image = self.inertia.times(at.a) + self.stiffness.times(at.x) + past.rest
        if len(at.T):
            image += self.coupling.times(at.T)
        if self.damping is not None:
            image += self.damping.times(at.v)
        past.image, past.u = image, at.x[self.active]
        return past

    def improve(self, d: FloatArray, past: Past) -> FloatArray:
        force = 0.0 if past.local is None else past.local.rows(d)
        (lo, hi), at = past.turning, past.at
        if hi == lo:  # nothing turns
            return past.image - force
        new = d if past.d is None else d - past.d  # only what is new is multiplied
        image: FloatArray = past.image - past.weights[lo:hi].dot(self.G[lo:hi].dot(new))
        if past.d is None:
            for g in range(lo, hi):
                image -= self.turning[g].times(past.kappa[g] * at.x + past.mu[g] * at.v)
        past.d, past.image = d, image
        return image - force

    def noise(self, d: FloatArray, past: Past) -> float:
        at = past.at
        size = self.inertia.magnitude(at.a) + np.abs(past.rest) + self.stiffness.magnitude(at.x)
        if self.damping is not None:
            size += self.damping.magnitude(at.v)
        if len(at.T):
            size += self.coupling.magnitude(at.T)
        if past.local is not None:
            size += np.abs(past.local.rows(d))
        wide = np.zeros(len(at.x))
        wide[self.active] = np.abs(d)
        for g, A in enumerate(self.turning):
            size += A.magnitude(abs(past.kappa[g]) * np.abs(at.x) + abs(past.mu[g]) * np.abs(at.v)
                                + abs(past.weights[g]) * wide)
        return EPS * float(np.linalg.norm(size))
