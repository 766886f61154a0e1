"""Heat capacity that grows with temperature, c(T): a local heat term that depends on T'."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.body import Body
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.compressed_local import CompressedLocal
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import Trial
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import scene_of

PHI = 0.5 * (1.0 - np.eye(3))
"""(3, 3): the linear shape functions at the middles of a triangle's edges."""


@dataclass(frozen=True, slots=True, eq=False)
class WarmCapacity:
    """Rows += integral slope (T - T_0) T' phi_i over triangles (three points each).

    cells (E, 3): places of the nodes in the columns; row_of (n,): place of each column in the
    rows, -1 for none; weights (E,): slope of rho c, J/(m^3 K^2), times a third of the volume.
    """

    rows: IntArray
    columns: IntArray
    cells: IntArray
    row_of: IntArray
    weights: FloatArray
    T0: float

    @property
    def elements(self) -> int:
        return len(self.cells)

    def _loads(self, x: FloatArray, v: FloatArray) -> FloatArray:
        """(E, 3) what each triangle adds to its nodes."""
        T, rate = x[self.cells] @ PHI, v[self.cells] @ PHI
        return np.asarray(((T - self.T0) * rate * self.weights[:, None]) @ PHI.T)

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        loads, at = self._loads(x, v), self.row_of[self.cells]
        kept = at >= 0
        return np.bincount(at[kept], loads[kept], minlength=len(self.rows)).astype(np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        T, rate, w = x[self.cells] @ PHI, v[self.cells] @ PHI, self.weights[:, None]
        by_T = np.einsum("eq,iq,jq->eij", w * rate, PHI, PHI)
        by_rate = np.einsum("eq,iq,jq->eij", w * (T - self.T0), PHI, PHI)
        J = by_T + by_rate * c1[self.cells][:, None, :]
        i, j = np.broadcast_arrays(self.row_of[self.cells][:, :, None], self.cells[:, None, :])
        kept = i >= 0
        return csr_array((J[kept], (i[kept], j[kept])), shape=(len(self.rows), len(self.columns)))

    def restrict(self, keep: IntArray) -> "WarmCapacity":
        new = np.full(len(self.rows) + 1, -1)
        new[keep] = np.arange(len(keep))
        row_of = new[self.row_of]
        near = (row_of[self.cells] >= 0).any(axis=1)
        used = np.unique(self.cells[near])
        return replace(
            self, rows=self.rows[keep], columns=self.columns[used], weights=self.weights[near],
            cells=np.searchsorted(used, self.cells[near]), row_of=row_of[used])

    def compress(self, trial: Trial, left: FloatArray) -> CompressedLocal:
        return CompressedLocal.of(self, trial, left)

    def contributions(
        self, left: FloatArray, x: FloatArray, v: FloatArray, t: FloatArray
    ) -> FloatArray:
        at = self.row_of[self.cells]
        sees = np.where(at >= 0, left[:, at], 0.0)
        return np.stack([np.einsum("lei,ei->el", sees, self._loads(x[:, k], v[:, k]))
                         for k in range(len(t))], axis=2)

    def weighted(self, weights: FloatArray) -> "WarmCapacity":
        some = np.flatnonzero(weights)
        rows = np.unique(self.row_of[self.cells[some]])
        return replace(self, cells=self.cells[some],
                       weights=(self.weights * weights)[some]).restrict(rows[rows >= 0])


def plate(**changes: Any) -> Scene:
    """A plate that a lamp heats on its left and a film cools from below."""
    return scene_of({
        "bodies": {"plate": {
            "use": "flexible", "thickness": 0.01, "fields": ["thermal"], "frame": "fixed",
            "material": {"rho": 7850, "k": 44.5, "c": 475},
            "mesh": {"use": "rectangle", "size": [0.2, 0.04], "divisions": [20, 4],
                     "diagonal": "alternating"}}},
        "loads": {
            "lamp": {"use": "heat_flux", "on": ["plate:left"], "flux": {
                "use": "sine", "amplitude": 3e5, "frequency": 0.02, "offset": 3e5}},
            "film": {"use": "convection", "on": ["plate:bottom"], "film": 200.0,
                     "temperature": 293.15}},
        "time": {"end": 20.0, "step": 0.5}, **changes})


def with_warm_capacity(scene: Scene, share: float = 1e-3) -> Model:
    """c(T) = c (1 + share (T - 293.15 K)), share in 1/K, on the plate, as assembly has it."""
    model = assemble(scene)
    body = model.parts["plate"]
    assert isinstance(body, Body) and body.mesh is not None and body.heat is not None
    corners, cells = body.mesh.points[body.mesh.cells], body.mesh.cells
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    third = 7850 * 475 * share * body.thickness * 0.5 * (ax * by - ay * bx) / 3.0
    numbers = body.position(model.layout, "thermal")
    term = WarmCapacity(numbers, numbers, cells, np.arange(len(numbers)), third, 293.15)
    (heat,) = model.separated.heat
    heat = replace(heat, local=(*heat.local, term))
    return replace(model, by_part={**model.by_part, "warm": (term,)},
                   separated=replace(model.separated, heat=(heat,)))
