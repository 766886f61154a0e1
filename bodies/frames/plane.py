"""The planar frame kernel: sums its items' equations of one body (equations.md, section 1)."""

from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.frames.plane_items import Inertia, Item
from sparsemor.bodies.frames.plane_motion import Motion, Views
from sparsemor.core import FloatArray, FrameWork


@dataclass(frozen=True, slots=True, eq=False)
class PlanarFrame:
    """Rigid coordinates (R_x, R_y, theta); `elastic` False when the body has no elastic block."""

    items: tuple[Item, ...]
    elastic: bool

    @property
    def rigid_size(self) -> int:
        return 3

    @property
    def border(self) -> int:
        return 3 + sum(i.forces for i in self.items)

    @property
    def p(self) -> int:
        return 2 * sum(i.pairs for i in self.items) if self.elastic else 0

    @property
    def generators(self) -> int:
        """None at rest, where no inertia but M u'' acts."""
        inert = any(isinstance(i, Inertia) for i in self.items)
        return 2 if self.elastic and inert else 0

    def evaluate(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float,
        s: FloatArray, s1: FloatArray, s2: FloatArray, form: FloatArray, forms: FloatArray,
        t: float, work: FrameWork,
    ) -> None:
        out = work.views
        if not isinstance(out, Views):
            out = work.views = Views(work)
        yl, vl, al = y.tolist(), v.tolist(), a.tolist()
        m = Motion(yl, vl[2], complex(al[0], al[1]), al[2], c1, c2, t)
        if self.elastic:
            m.s = s.view("c16").tolist()
            m.s1, m.s2 = s1.view("c16").tolist(), s2.view("c16").tolist()
            m.form, m.forms = form.tolist(), forms.tolist()
        total = [0.0] * 9
        j, k = 0, 3
        for item in self.items:
            item.evaluate(m, j, k, total, out)
            j += item.pairs
            k += item.forces
        out.write(total)

    def drive(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float, t: float,
        work: FrameWork,
    ) -> None:
        # its derivatives are a few complex numbers, not worth a second way through the items
        s, form = np.zeros(self.p), np.zeros(self.generators)
        self.evaluate(y, v, a, c1, c2, s, s, s, form, np.zeros(2 * len(form)), t, work)

    def exact(
        self, v: FloatArray, a: FloatArray, c1: float, c2: float, work: FrameWork
    ) -> None:
        out = work.views
        if isinstance(out, Views) and self.elastic:
            m = Motion([0.0] * 3, float(v[2]), 0j, float(a[2]), c1, c2, 0.0)
            for item in self.items:
                if isinstance(item, Inertia):
                    item.exact(m, out)

    @property
    def without_push(self) -> tuple[Item, ...]:
        """None: `drive` evaluates every item."""
        return ()

    def time_derivative(self, order: int, t: float, h: float) -> "PlanarFrame | None":
        """None: no attachment of it depends on time alone."""
        return None

    @property
    def shape_columns(self) -> tuple[tuple[int, int], ...]:
        """Inertia's second pair is (M X, M J X)."""
        j, found = 0, []
        for item in self.items:
            if isinstance(item, Inertia) and self.elastic:
                found += [(2 * j + 2, 0), (2 * j + 3, 1)]
            j += item.pairs
        return tuple(found)

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "PlanarFrame":
        if not self.elastic:
            return self
        sl, j, items = s.view("c16").tolist(), 0, []
        for item in self.items:
            items.append(item.shifted(sl[j : j + item.pairs], quadratic))
            j += item.pairs
        return PlanarFrame(tuple(items), self.elastic)
