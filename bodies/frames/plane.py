"""Equations of a body frame in the plane, evaluated with complex numbers.

The same equations as for a frame in space, but several times faster
(`tests/laws/bodies/test_plane_kernel.py` compares them).
"""

from cmath import exp
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from sparsemor.bodies.frames.frame import ItemFrame
from sparsemor.bodies.frames.items import PlanarItem
from sparsemor.bodies.frames.plane_items import FUNCTIONS, NUMBERS, PlaneFunction, evaluate_parts
from sparsemor.bodies.frames.plane_motion import SUMS, PlaneMotion, Views, views, write
from sparsemor.bodies.frames.plane_springs import relative_law
from sparsemor.core import Amplitude, FloatArray
from sparsemor.core.protocols import FrameArrays, FrameWork

_Evaluated: TypeAlias = tuple[
    PlaneFunction, tuple[float, ...], Amplitude | None, int, int, int]
"""Part of the equations: function, numbers, amplitude, and where it begins."""


@dataclass(frozen=True, eq=False)
class PlanarFrame(ItemFrame[PlanarItem]):
    """Equations of a body frame in the plane, with rigid coordinates (R_x, R_y, theta)."""

    @cached_property
    def evaluated(self) -> tuple[_Evaluated, ...]:
        """Items (forces, joints, inertia) in complex form, each with the numbers of its first pair
        of functionals, first coordinate of the other body and first multiplier."""
        return tuple((*item.in_plane(), j // 2, o, k)
                     for item, (j, o, k) in zip(self.items, self.starts, strict=True))

    def evaluate(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float,
        s: FloatArray, forms: FloatArray, t: float, work: FrameWork,
    ) -> None:
        out = work.views
        if not isinstance(out, Views):
            out = work.views = views(work)
        yl, vl, al = y.tolist(), v.tolist(), a.tolist()
        e = exp(1j * yl[2])
        s0, s1, s2 = s.view("c16").tolist() if self.elastic else ((), (), ())
        m = PlaneMotion(yl, vl, complex(yl[0], yl[1]), e, e.conjugate(), vl[2], al[2],
                   complex(al[0], al[1]), c1, c2, t, self.elastic, s0, s1, s2,
                   forms.tolist(), work.fresh)
        total = [0j] * SUMS
        for function, numbers, amplitude, j, o, k in self.evaluated:
            g = 1.0 if amplitude is None else amplitude(t)
            function(numbers, g, m, j, o, k, total, out)
        write(total, work.fresh, out)

    def arrays(self) -> FrameArrays | None:
        """Equations as a function on arrays, None where a part has no numbers."""
        parts = [item.in_plane() for item in self.items]
        if any(part.function not in FUNCTIONS for part in parts):
            return None
        kinds = [FUNCTIONS.index(part.function) for part in parts]
        numbers = np.zeros((len(parts), NUMBERS))
        for row, part in zip(numbers, parts, strict=True):
            row[: len(part.numbers)] = part.numbers
        return FrameArrays(
            np.array(kinds, dtype=np.int64), numbers,
            np.array(self.starts, dtype=np.int64).reshape(-1, 3),
            tuple(part.amplitude for part in parts), evaluate_parts,
            (relative_law, *FUNCTIONS, write), FUNCTIONS)

    def drive(
        self, y: FloatArray, v: FloatArray, a: FloatArray, t: float, work: FrameWork
    ) -> None:
        # its derivatives are a few complex numbers, not worth a second way through the items
        s, forms = np.zeros((3, self.p)), np.zeros(3 * self.generators)
        self.evaluate(y, v, a, 0.0, 0.0, s, forms, t, work)

    def exact(
        self, v: FloatArray, a: FloatArray, c1: float, c2: float, work: FrameWork
    ) -> None:
        """Derivatives that are quadratic in the displacements u."""
        w, al = float(v[2]), float(a[2])
        if self.inertias:
            work.kappa_y[2, 0], work.kappa_y[2, 1] = -2 * w * c1, c2
            work.mu_y[2, 1] = 2 * c1
            work.quad[2, 0, 0], work.quad[2, 1, 0], work.quad[2, 2, 1] = al, 2 * w, -1.0
        for item in self.items:
            item.bend(work)

    @property
    def without_push(self) -> tuple[PlanarItem, ...]:
        """Empty: `drive` evaluates every item in the plane."""
        return ()

    def time_derivative(self, order: int, t: float, h: float) -> "PlanarFrame | None":
        """None: no constraint of a planar frame depends explicitly on time."""
        return None
