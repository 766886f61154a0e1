"""Springs and heat links between two bodies, a term that no body claims; two bars to join."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.core import Term, Trial
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.compressed_local import CompressedLocal
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import scene_of

PLACES = 12
"""Unknowns of a pair: two frames (R_x, R_y, theta), two displacements each, two temperatures."""


@dataclass(frozen=True, slots=True, eq=False)
class Springs(Term):
    """Force (k + k3 |d|^2) d + c d' on d = r_1 - r_2, heat h (T_1 - T_2)(1 + b (T_1 - T_2)).

    X (P, 4): body-frame positions of the pairs' ends; row_of, column_of (P, 12): their places in
    rows and columns, -1 for none.
    """

    rows: IntArray
    columns: IntArray
    X: FloatArray
    row_of: IntArray
    column_of: IntArray
    stiffness: tuple[float, float]
    damping: float
    film: tuple[float, float]
    source: str = "springs"

    @classmethod
    def between(
        cls, layout: Layout, first: FloatingBody, second: FloatingBody,
        nodes: tuple[IntArray, IntArray],
        stiffness: tuple[float, float] = (2e3, 5e5), damping: float = 3.0,
        film: tuple[float, float] = (5.0, 0.02),
    ) -> "Springs":
        """Pairs of nodes of two bodies with the same fields."""
        places, X = [], []
        for body, at in zip((first, second), nodes, strict=True):
            rigid, elastic, thermal = (_numbers(layout, f"{body.name}.{f}") for f in (
                "rigid", "elastic", "thermal"))
            u = np.full(2 * len(body.X), -1)
            T = np.full(len(body.X), -1)
            if body.elasticity is not None:
                u[body.elasticity.free] = elastic
            if body.heat is not None:
                T[body.heat.free] = thermal
            frame = rigid if len(rigid) else np.full(3, -1)
            places.append((np.tile(frame, (len(at), 1)), u.reshape(-1, 2)[at], T[at][:, None]))
            X += [*body.X[at].T]
        (q1, u1, T1), (q2, u2, T2) = places
        at = np.concatenate([q1, q2, u1, u2, T1, T2], axis=1)
        numbers = np.unique(at[at >= 0])
        local = np.where(at >= 0, np.searchsorted(numbers, at), -1)
        return cls(numbers, numbers, np.stack(X, axis=1), local, local, stiffness, damping, film)

    @property
    def elements(self) -> int:
        return len(self.X)

    def _local(self, q: Any, w: Any) -> Any:
        """(P, 12) rows of each pair from its unknowns q and rates w, real or complex (P, 12)."""
        ends, rates, turns = [], [], []
        for k, (frame, u) in enumerate(((0, 6), (3, 8))):
            c, s = np.cos(q[:, frame + 2]), np.sin(q[:, frame + 2])
            zx, zy = (self.X[:, 2 * k + i] + q[:, u + i] for i in range(2))
            rx, ry = c * zx - s * zy, s * zx + c * zy
            ux, uy = w[:, u], w[:, u + 1]
            turn = w[:, frame + 2]
            ends.append((q[:, frame] + rx, q[:, frame + 1] + ry))
            rates.append((w[:, frame] + c * ux - s * uy - turn * ry,
                          w[:, frame + 1] + s * ux + c * uy + turn * rx))
            turns.append((c, s, rx, ry))
        dx, dy = (ends[0][i] - ends[1][i] for i in range(2))
        k = self.stiffness[0] + self.stiffness[1] * (dx * dx + dy * dy)
        fx = k * dx + self.damping * (rates[0][0] - rates[1][0])
        fy = k * dy + self.damping * (rates[0][1] - rates[1][1])
        dT = q[:, 10] - q[:, 11]
        heat = self.film[0] * dT * (1.0 + self.film[1] * dT)
        out = np.zeros_like(q)
        for sign, frame, u, (c, s, rx, ry) in ((1, 0, 6, turns[0]), (-1, 3, 8, turns[1])):
            out[:, frame], out[:, frame + 1] = sign * fx, sign * fy
            out[:, frame + 2] = sign * (rx * fy - ry * fx)
            out[:, u], out[:, u + 1] = sign * (c * fx + s * fy), sign * (c * fy - s * fx)
        out[:, 10], out[:, 11] = heat, -heat
        return out

    def _gathered(self, x: FloatArray) -> FloatArray:
        padded = np.append(x, 0.0)
        return np.asarray(padded[self.column_of])

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        local = self._local(self._gathered(x), self._gathered(v))
        keep = self.row_of >= 0
        return np.bincount(
            self.row_of[keep], local[keep], minlength=len(self.rows)).astype(np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        q, w, c = (self._gathered(z) for z in (x, v, c1))
        J, tiny = np.zeros((len(q), PLACES, PLACES)), 1e-30
        for j in range(PLACES):  # complex steps: exact to rounding
            dq, dw = q.astype(complex), w.astype(complex)
            dq[:, j] += 1j * tiny
            dw[:, j] += 1j * tiny * c[:, j]
            J[:, :, j] = self._local(dq, dw).imag / tiny
        i, j = np.broadcast_arrays(self.row_of[:, :, None], self.column_of[:, None, :])
        keep = (i >= 0) & (j >= 0)
        return csr_array((J[keep], (i[keep], j[keep])), shape=(len(self.rows), len(self.columns)))

    def restrict(self, keep: IntArray) -> "Springs":
        new = np.full(len(self.rows) + 1, -1)
        new[keep] = np.arange(len(keep))
        rows = new[self.row_of]
        near = (rows >= 0).any(axis=1)
        at = self.column_of[near]
        used = np.unique(at[at >= 0])
        return replace(
            self, rows=self.rows[keep], columns=self.columns[used], X=self.X[near],
            row_of=rows[near], column_of=np.where(at >= 0, np.searchsorted(used, at), -1))

    def compress(self, trial: Trial, left: FloatArray) -> CompressedLocal:
        return CompressedLocal.of(self, trial, left)


def _numbers(layout: Layout, name: str) -> IntArray:
    return np.arange(layout.size)[layout[name]] if name in layout else np.zeros(0, np.int64)


def bars(divisions: tuple[int, int] = (8, 2), **changes: Any) -> Scene:
    """Two heated bars, end to end, each on a pin at its far end."""
    bodies = {}
    for name, x, reference in (("one", 0.0, 300.0), ("two", 0.55, 280.0)):
        bodies[name] = {
            "use": "flexible", "thickness": 0.02, "fields": ["elastic", "thermal"],
            "material": {"E": 7e8, "nu": 0.3, "rho": 2700, "alpha": 2e-5, "k": 1500, "c": 90},
            "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [0.5, 0.1],
                     "divisions": list(divisions)},
            "reference": {"chord": ["bottom_left", "bottom_right"]},
            "reference_temperature": reference, "pose": {"position": [x, 0.0]}}
    return scene_of({
        "bodies": bodies,
        "joints": {"a": {"use": "revolute", "between": ["ground", "one:left"]},
                   "b": {"use": "revolute", "between": ["ground", "two:right"]}},
        "loads": {"gravity": {"use": "gravity", "g": [0.0, -9.81]}},
        "time": {"end": 0.03, "step": 1e-3}, "integrator": "bdf1", **changes})


def coupled(scene: Scene) -> Model:
    """Three springs and heat links between the facing ends' lower, middle and upper points."""
    model = assemble(scene)
    one, two = model.parts["one"], model.parts["two"]
    assert isinstance(one, FloatingBody) and isinstance(two, FloatingBody)
    right, left = one.points["right"], two.points["left"]
    some = np.linspace(0, len(right) - 1, 3).astype(int)
    term = Springs.between(model.layout, one, two, (right[some], left[some]))
    return with_other(model, term)


def with_other(model: Model, term: Term) -> Model:
    """As assembly does with a term that no body claims."""
    required = {}
    for name, rows in model.required.items():
        at = model.layout[name]
        here = term.rows[(term.rows >= at.start) & (term.rows < at.stop)] - at.start
        required[name] = np.union1d(rows, here)
    return replace(model, by_part={**model.by_part, "springs": (term,)}, required=required,
                   separated=replace(model.separated, other=(term,)))
