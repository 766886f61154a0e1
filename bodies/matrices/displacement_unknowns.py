"""Displacement unknowns of a body that is given by matrices: nodal displacements, nodal rotations,
and modal coordinates without a place."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, eye_array, kron

from sparsemor.bodies.frames.rotation import GENERATORS
from sparsemor.core import Csr, FloatArray, InputError, IntArray

MODAL = -1
"""Node and component of an unknown without a place."""


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Node and component of n unknowns of nodes X (N, d), m: 0..d-1 displacements, d and up
    rotations (in the plane one), -1 modal coordinates."""

    X: FloatArray
    node: IntArray
    component: IntArray

    @classmethod
    def of_labels(cls, X: FloatArray, node: IntArray, direction: IntArray) -> "Unknowns":
        """Unknowns of nodes X (N, d), m: node (n,) row in X of each, `MODAL` for one without a
        place; direction (n,): 1 to 3 displacements, 4 to 6 rotations as in FE codes, in the plane
        1, 2 and 6. InputError for others, and for an unknown that is there twice."""
        d = X.shape[1]
        to = {0: MODAL, 1: 0, 2: 1, 6: 2} if d == 2 else {0: MODAL, **{i + 1: i for i in range(6)}}
        strange = np.setdiff1d(direction[node != MODAL], list(to))
        if strange.size:
            raise InputError(f"direction {strange[0]} of an unknown: those of a body "
                             f"{'in the plane are 1, 2 and 6' if d == 2 else 'are 1 to 6'}")
        component = np.array([to.get(int(k), MODAL) for k in direction], dtype=np.int64)
        component[node == MODAL] = MODAL
        node = np.where(component == MODAL, MODAL, node)
        keys = (node * 8 + component)[node != MODAL]
        _, count = np.unique(keys, return_counts=True)
        if (count > 1).any():
            raise InputError("an unknown is there twice: each has a node and direction of its own")
        return cls(X, node, component)

    @classmethod
    def modal_of(cls, X: FloatArray, count: int) -> "Unknowns":
        """Unknowns without a place of nodes X (N, d)."""
        none = np.full(count, MODAL, dtype=np.int64)
        return cls(X, none, none)

    @property
    def size(self) -> int:
        return len(self.node)

    @property
    def d(self) -> int:
        return int(self.X.shape[1])

    @property
    def turning(self) -> bool:
        """True if nodes have rotations."""
        return bool((self.component >= self.d).any())

    @property
    def modal(self) -> IntArray:
        """Numbers of the unknowns without a place."""
        return np.flatnonzero(self.node == MODAL)

    @cached_property
    def displacements(self) -> Csr:
        """(n, d N) ones: the displacement d * node + component that each unknown is."""
        return self._selection(0, self.d)

    @cached_property
    def rotations(self) -> Csr:
        """(n, r N) ones: the rotation r * node + axis that each unknown is."""
        return self._selection(self.d, 2 * self.d - 3)

    def _selection(self, first: int, count: int) -> Csr:
        mine = np.flatnonzero((self.component >= first) & (self.component < first + count))
        at = count * self.node[mine] + self.component[mine] - first
        return coo_array((np.ones(len(mine)), (mine, at)),
                         shape=(self.size, count * len(self.X))).tocsr()

    def field(self, B: FloatArray) -> FloatArray:
        """(n,) nodal values of the field x -> B x: displacements B X, and the rotations of the
        skew part of B."""
        skew = 0.5 * (B - B.T)
        axis = np.array([skew[1, 0]]) if self.d == 2 else np.array(
            [skew[2, 1], skew[0, 2], skew[1, 0]])
        return np.asarray(self.displacements @ (self.X @ B.T).ravel()
                          + self.rotations @ np.tile(axis, len(self.X)))

    @cached_property
    def rigid_modes(self) -> FloatArray:
        """(n, 3 or 6) translations, then rotations about the origin."""
        moved = [self.displacements @ np.tile(e, len(self.X)) for e in np.eye(self.d)]
        return np.stack([*moved, *(self.field(G) for G in GENERATORS[self.d])], axis=1)

    def matrix(self, B: FloatArray) -> Csr:
        """(n, n) matrix of B on the displacements of each node; (tr B - B^T) / 2 on its rotations,
        in the plane tr B / 2, as for a rigid isotropic piece of the body at the node; and its mean
        tr B / d on modal coordinates."""
        mean = float(np.trace(B)) / self.d * (self.component < 0)
        found = diags_array(mean, format="csr")
        turned = 0.5 * (np.trace(B) * np.eye(2 * self.d - 3) - (B.T if self.d == 3 else 0.0))
        for P, each in ((self.displacements, B), (self.rotations, turned)):
            found = found + P @ kron(eye_array(len(self.X)), csr_array(each), format="csr") @ P.T
        return found.tocsr()

    def numbers(self, displacements: IntArray, key: str) -> IntArray:
        """Sorted unknowns of displacements d * node + component; InputError under `key` for one
        that is none."""
        rows = self.displacements.tocsc()[:, displacements]
        missing = displacements[np.asarray(rows.sum(axis=0)).ravel() == 0]
        if missing.size:
            raise InputError(f"the matrices have no unknown {'xyz'[missing[0] % self.d]} of node "
                             f"number {missing[0] // self.d + 1} in the order of the file", key)
        return np.sort(rows.tocoo().row).astype(np.int64)

    def places(self, mine: IntArray) -> tuple[FloatArray, IntArray]:
        """Coordinates (k, d), m, and component (k,) of some unknowns; each modal one has a place of
        its own on the diagonal of the body's box, and component -1."""
        X, at = self.X[np.maximum(self.node, 0)].copy(), self.modal
        low, size = self.X.min(axis=0), np.ptp(self.X, axis=0)
        X[at] = low + np.linspace(0.0, 1.0, len(at))[:, None] * size
        return X[mine], self.component[mine]
