"""Elastic block of a reduced model with prescribed frame motion inside a step (notation:
prescribed_frame_block.py)."""

from abc import abstractmethod
from dataclasses import dataclass
from math import sqrt
from typing import ClassVar

import numpy as np

from sparsemor.core import Amplitude, FloatArray, IntArray
from sparsemor.reducers.linalg.modal_coordinates import carried, dense, times
from sparsemor.reducers.step.acceptance import EPS, LEAST
from sparsemor.reducers.step.blocks.elastic_local import LocalForces, ReducedLocal
from sparsemor.reducers.step.blocks.prescribed_frame_block import Past, PrescribedBlock
from sparsemor.reducers.step.operators import TestedElastic
from sparsemor.reducers.step.predictor import Prediction
from sparsemor.reducers.step.time_tables import Moving, TimeTable, along, tabulated

LEADING = 64
"""Number of leading (soft) modes in which a second product per iteration is worthwhile."""


class ReducedPrescribed(PrescribedBlock):
    """Block with s active atoms, whose rows are those of D^-1 in their coefficients. Factors of b:
    base (s,); E (s, p) times the frame's sigma; loads (s, j) times amplitudes, and tabulated
    loads."""

    proved: ClassVar[bool] = True
    base: FloatArray
    E: FloatArray
    loads: FloatArray
    amplitudes: tuple[Amplitude, ...]
    tables: tuple[Moving, ...]
    local: LocalForces | None
    active: IntArray | None
    c1: float

    @abstractmethod
    def bounds(self, kappa: FloatArray) -> FloatArray:
        """Bounds (T,) of the contraction factor for the frame's rotation kappa (T, g)."""

    def time_table(self, drive: TimeTable) -> TimeTable:
        """kappa, mu, sigma, the bound of the contraction factor, and the part of b that depends on
        time only."""
        decided = Decided(self, drive)
        # a support that may change with the next step does not pay for all times
        if self.active is not None:
            return TimeTable(decided)
        return TimeTable.of(decided, np.array(drive.times))

    def decided(self, drive: TimeTable, times: FloatArray) -> FloatArray:
        """Values (T, m) of `time_table` at times (T,), s."""
        driven, p = drive.along(times), self.E.shape[1]
        n = driven.shape[1]
        g = (n - p) // 2
        rows = np.empty((len(times), n + 1 + len(self.base)))
        rows[:, :n] = driven
        rows[:, n] = self.bounds(rows[:, :g] + self.c1 * rows[:, g : 2 * g])
        rows[:, n + 1 :] = along(rows[:, 2 * g : n].dot(self.E.T) + self.base, self.loads,
                                 self.amplitudes, self.tables, times)
        return rows

    def contraction(self, past: Past) -> float:
        return past.bound if self.local is None else max(past.bound, LEAST)


@dataclass(frozen=True, slots=True, eq=False)
class CompressedPrescribed(ReducedPrescribed):
    """Reduced block with s active atoms: all operators are dense and small, independent of the
    mesh.

    Factors of b: stiffness, damping and inertia times u0, v0 and a0, (s, k) or diagonals, damping
    None where there is none; coupling (s, kt) times temperatures; base; E (s, p) times sigma; loads
    (s, j) times amplitudes, and tabulated loads. G (g, k, s): transposed D^-1 M_g, so that
    consecutive ones form one matrix; leading (g r, r): their first rows and columns, of soft modes,
    r = 0 where some atoms are not active; sizes (g, 3): Frobenius norms of each whole matrix, of
    its leading part, and of the rest; inverse (s,): D^-1 where D is diagonal.
    """

    inertia: FloatArray
    stiffness: FloatArray
    damping: FloatArray | None
    coupling: FloatArray
    base: FloatArray
    E: FloatArray
    loads: FloatArray
    G: FloatArray
    leading: FloatArray
    sizes: FloatArray
    c1: float
    active: IntArray | None
    amplitudes: tuple[Amplitude, ...]
    tables: tuple[Moving, ...] = ()
    local: LocalForces | None = None
    inverse: FloatArray | None = None

    @classmethod
    def of(
        cls, b: TestedElastic, left: FloatArray, support: IntArray | None, c1: float, c2: float
    ) -> "CompressedPrescribed":
        """Reduced block from the tested operators, for steps with c1 and c2; left (s, m): left
        inverse of the tested D on the support, left @ D_S = 1, as D^-1 in the tested rows."""
        G = np.stack([left @ A for A in b.generators]) if len(b.generators) else np.zeros(
            (0, len(left), b.mass.shape[1]))
        below = np.ascontiguousarray(G.transpose(0, 2, 1))
        r, inverse = min(LEADING, len(left)) if support is None else 0, carried(left)
        sizes = []
        for A in G if support is None else G[:, :, support]:
            all_of_it, lead = float(np.sum(A**2)), float(np.sum(A[:r, :r] ** 2))
            sizes.append((sqrt(all_of_it), sqrt(lead), _beyond(A, r)))
        return cls(
            carried(-left @ b.mass), carried(-left @ b.stiffness),
            carried(-left @ b.damping) if b.damping.any() else None,
            np.ascontiguousarray(left @ b.coupling), -left @ b.constant, -left @ b.directions,
            left @ b.loads, below, G[:, :r, :r].reshape(len(G) * r, r),
            np.array(sizes).reshape(len(G), 3), c1, support,
            b.amplitudes, tabulated(b.tables, left, support is None),
            ReducedLocal.of(b.local, left), inverse if inverse.ndim == 1 else None)

    def rates(self, k: int) -> tuple[FloatArray, FloatArray]:
        none = np.zeros((len(self.base), k))
        return none if self.damping is None else -dense(self.damping), -dense(self.inertia)

    def begin(self, at: Prediction, c1: float, c2: float, table: FloatArray) -> Past:
        g = len(self.G)
        past, n = Past(at, c1, c2, table, g), 2 * g + self.E.shape[1]
        past.bound, past.rest = float(table[n]), table[n + 1 :]
        image = times(self.inertia, at.a)
        image += times(self.stiffness, at.x)
        if len(at.T):
            image += self.coupling.dot(at.T)
        image += past.rest
        if self.damping is not None:
            image += times(self.damping, at.v)
        past.image, past.u = image, at.x if self.active is None else at.x[self.active]
        return past

    def improve(self, d: FloatArray, past: Past) -> FloatArray:
        force = 0.0 if past.local is None else past.local.rows(d)
        (lo, hi), at = past.turning, past.at
        if hi == lo:  # nothing turns
            return past.image - force
        new = d if past.d is None else d - past.d  # only what is new is multiplied
        push = np.multiply.outer(past.weights[lo:hi], self._wide(new))
        if past.d is None:
            push += np.multiply.outer(past.kappa[lo:hi], at.x)
            push += np.multiply.outer(past.mu[lo:hi], at.v)
        past.d, past.image = d, past.image - push.ravel().dot(
            self.G[lo:hi].reshape(push.size, -1))
        image: FloatArray = past.image - force
        r = self.leading.shape[1]
        if not r:
            return image
        found = image.copy()
        found[:r] -= past.weights.dot(self.leading.dot(image[:r] - d[:r])
                                      .reshape(len(self.G), r))
        return found

    def bounds(self, kappa: FloatArray) -> FloatArray:
        """|E - L| + |L| |E| with E = sum_g kappa_g D^-1 M_g and its leading part L."""
        whole, lead, rest = np.abs(kappa).dot(self.sizes).T
        return np.asarray(rest + lead * whole)

    def _wide(self, d: FloatArray) -> FloatArray:
        """All unknowns, from the active ones."""
        if self.active is None:
            return d
        wide = np.zeros(self.G.shape[1])
        wide[self.active] = d
        return wide

    def noise(self, d: FloatArray, past: Past) -> float:
        at = past.at
        size = times(np.abs(self.inertia), np.abs(at.a)) + np.abs(past.rest)
        size += times(np.abs(self.stiffness), np.abs(at.x))
        if self.damping is not None:
            size += times(np.abs(self.damping), np.abs(at.v))
        if len(at.T):
            size += np.abs(self.coupling) @ np.abs(at.T)
        if past.local is not None:
            size += np.abs(past.local.rows(d))
        if len(self.G):
            turned = np.multiply.outer(np.abs(past.kappa), np.abs(at.x))
            turned += np.multiply.outer(np.abs(past.mu), np.abs(at.v))
            turned += np.multiply.outer(np.abs(past.weights), self._wide(np.abs(d)))
            size += turned.ravel() @ np.abs(self.G).reshape(turned.size, -1)
        return EPS * float(np.linalg.norm(size))


@dataclass(frozen=True, slots=True, eq=False)
class Decided:
    """Functions of time of a block whose frame moves as `drive` says."""

    block: ReducedPrescribed
    drive: TimeTable

    def __call__(self, times: FloatArray) -> FloatArray:
        return self.block.decided(self.drive, times)


def _beyond(A: FloatArray, r: int) -> float:
    """Frobenius norm of A (s, s) without its leading r rows and columns."""
    return sqrt(float(np.sum(A[r:] ** 2)) + float(np.sum(A[:r, r:] ** 2)))
