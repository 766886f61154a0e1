"""The spatial frame kernel: sums its items' equations of one body (equations.md, section 1)."""

from dataclasses import dataclass, replace

import numpy as np

from sparsemor.bodies.frames.inertia import FIRST, Inertia
from sparsemor.bodies.frames.items import Item, Nothing, Pushing, Timed
from sparsemor.bodies.frames.many_times import MotionAtTimes, Pushes
from sparsemor.bodies.frames.moments import moments_of
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.core import FloatArray, FrameWork


@dataclass(frozen=True, slots=True, eq=False)
class SpatialFrame:
    """Border unknowns: own rigid coordinates (`size`: position and quaternion 7, position and angle
    4), those of the other bodies that items read, then the items' forces. `elastic` False when the
    body has no elastic block. Where the frame's motion is prescribed, items act on displacements
    by `push`; `without_push` finds those that could not."""

    items: tuple[Item, ...]
    elastic: bool
    size: int

    @property
    def rigid_size(self) -> int:
        return self.size + sum(i.others for i in self.items)

    @property
    def border(self) -> int:
        return self.rigid_size + sum(i.forces for i in self.items)

    @property
    def p(self) -> int:
        return sum(i.directions for i in self.items) if self.elastic else 0

    @property
    def generators(self) -> int:
        """None at rest, where no inertia but M u'' acts."""
        inert = any(isinstance(i, Inertia) or (isinstance(i, Nothing) and i.inert)
                    for i in self.items)
        return moments_of(self.size).count if self.elastic and inert else 0

    def evaluate(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float,
        s: FloatArray, s1: FloatArray, s2: FloatArray, form: FloatArray, forms: FloatArray,
        t: float, work: FrameWork,
    ) -> None:
        out = work.views
        if not isinstance(out, Sums):
            out = work.views = Sums(work, self.size)
        out.clear()
        m = Motion(self.size, y, v, a, c1, c2, t)
        m.elastic = self.elastic
        if self.elastic:
            m.s, m.s1, m.s2, m.form, m.forms = s, s1, s2, form, forms
            work.tau[3 : self.size] = 0.0
        j, o, k = 0, self.size, self.rigid_size
        for item in self.items:
            item.evaluate(m, j, o, k, out)
            j, o, k = j + item.directions, o + item.others, k + item.forces
        out.finish(m)

    def drive(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float, t: float,
        work: FrameWork,
    ) -> None:
        out = work.views
        if not isinstance(out, Sums):
            out = work.views = Sums(work, self.size)
        m, j = Motion(self.size, y, v, a, c1, c2, t, derivatives=False), 0
        for item in self.items:
            if isinstance(item, Pushing):
                item.push(m, j, out)
            j += item.directions

    def drive_along(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float,
        times: FloatArray,
    ) -> FloatArray:
        """(T, 2 g + p): what `drive` gives, at all times (T,) at once."""
        m, j = MotionAtTimes(self.size, y, v, a, c1, times), 0
        out = Pushes(len(times), self.p, self.generators)
        for item in self.items:
            if isinstance(item, Pushing):
                item.push(m, j, out)
            j += item.directions
        return np.hstack([out.coefficients, out.sigma])

    def exact(
        self, v: FloatArray, a: FloatArray, c1: float, c2: float, work: FrameWork
    ) -> None:
        out = work.views
        if isinstance(out, Sums) and self.elastic:
            for item in self.items:
                if isinstance(item, Inertia):
                    item.exact(out.motion, out)

    @property
    def without_push(self) -> tuple[Item, ...]:
        """Items that act on displacements by more than unknown forces, but have no `push`."""
        return tuple(i for i in self.items
                     if i.directions and not i.forces and not isinstance(i, Pushing))

    def time_derivative(self, order: int, t: float, h: float) -> "SpatialFrame | None":
        """The frame of the partial derivative by time of its items' constraint rows, at t, s."""
        made: list[Item] = []
        for i in self.items:
            of_time = i.time_derivative(order, t, h) if isinstance(i, Timed) else None
            made.append(of_time or Nothing(
                i.directions, i.others, i.forces, isinstance(i, Inertia)))
        zero = all(isinstance(i, Nothing) for i in made)
        return None if zero else replace(self, items=tuple(made))

    @property
    def shape_columns(self) -> tuple[tuple[int, int], ...]:
        """The second-moment directions of the inertia are M_g X."""
        j, found = 0, []
        for item in self.items:
            if isinstance(item, Inertia) and self.elastic:
                found += [(j + FIRST + g, g) for g in range(item.moments.count)]
            j += item.directions
        return tuple(found)

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "SpatialFrame":
        if not self.elastic:
            return self
        j, items = 0, []
        for item in self.items:
            items.append(item.shifted(np.asarray(s[j : j + item.directions]), quadratic))
            j += item.directions
        return replace(self, items=tuple(items))
