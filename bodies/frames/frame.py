"""Equations of a body frame as sums over items: inertia, forces, joints (equations.md, section 1).
"""

from cmath import exp
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, Self, TypeAlias, TypeVar

import numpy as np

from sparsemor.bodies.frames.frame_items import Item, Nothing, PlanarItem, SpatialItem
from sparsemor.bodies.frames.inertia import Inertia
from sparsemor.bodies.frames.mass_moments import moments_of
from sparsemor.bodies.frames.motion import Motion, MotionAtTimes, Pushes, Sums
from sparsemor.bodies.frames.plane_items import FUNCTIONS, NUMBERS, PlaneFunction, evaluate_parts
from sparsemor.bodies.frames.plane_motion import SUMS, PlaneMotion, Views, views, write
from sparsemor.bodies.frames.plane_springs import relative_law
from sparsemor.bodies.frames.space_frame import space_arrays
from sparsemor.core import Amplitude, FloatArray
from sparsemor.core.protocols.body_frame import BodyFrame, FrameArrays, FrameWork

AnyItem = TypeVar("AnyItem", bound=Item)


@dataclass(frozen=True, eq=False)
class ItemFrame(BodyFrame, Generic[AnyItem]):
    """Equations of a body frame as a sum over items.

    Unknowns: own rigid coordinates (`size`: in the plane position and angle 3; in space position
    and quaternion 7, or angle 4), those of the other bodies that items read, then the items'
    multipliers. `elastic`: True if the body has displacement unknowns.
    """

    items: tuple[AnyItem, ...]
    elastic: bool
    size: int

    @cached_property
    def rigid_size(self) -> int:
        """Number of rigid coordinates: own ones and those of other bodies that items read."""
        return self.size + sum(i.others for i in self.items)

    @cached_property
    def border(self) -> int:
        """Number of rigid coordinates and multipliers (the bordered unknowns of the linear system).
        """
        return self.rigid_size + sum(i.forces for i in self.items)

    @cached_property
    def p(self) -> int:
        """Number of functionals of the displacements that the items use."""
        return sum(i.directions for i in self.items) if self.elastic else 0

    @cached_property
    def generators(self) -> int:
        """Number of inertia matrices M_g and of others (`Item.matrices`); there are none of inertia
        for a frame at rest, where M u'' is the only inertia force."""
        if not self.elastic:
            return 0
        inert = any(isinstance(i, Inertia) or (isinstance(i, Nothing) and i.inert)
                    for i in self.items)
        of_inertia = moments_of(self.size).count if inert else 0
        return of_inertia + sum(i.matrices for i in self.items)

    @cached_property
    def starts(self) -> tuple[tuple[int, int, int], ...]:
        """For each item (j, o, k): the numbers of its first functional, first coordinate of another
        body and first multiplier."""
        made, j, o, k = [], 0, self.size, self.rigid_size
        for item in self.items:
            made.append((j, o, k))
            j, o, k = j + item.directions, o + item.others, k + item.forces
        return tuple(made)

    @cached_property
    def inertias(self) -> tuple[tuple[int, Inertia], ...]:
        """Inertia items of a flexible body, with the number of their first functional."""
        return tuple((j, i) for i, (j, _, _) in zip(self.items, self.starts, strict=True)
                     if self.elastic and isinstance(i, Inertia))

    @property
    def shape_columns(self) -> tuple[tuple[int, int], ...]:
        """Pairs (number of the functional, g) of the inertia's second-moment functionals M_g X."""
        return tuple((j + len(i.moment) + g, g) for j, i in self.inertias
                     for g in range(i.moments.count))

    @property
    def stiff_columns(self) -> tuple[tuple[int, int], ...]:
        """Pairs of all functionals and the matrices of the last item."""
        last = self.items[-1].matrices if self.items and self.elastic else 0
        return tuple((j, self.generators - last + j) for j in range(last))

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> Self:
        if not self.elastic:
            return self
        return replace(self, items=tuple(
            i.shifted(np.asarray(s[j : j + i.directions]), quadratic)
            for i, (j, _, _) in zip(self.items, self.starts, strict=True)))


@dataclass(frozen=True, eq=False)
class SpatialFrame(ItemFrame[SpatialItem]):
    """Equations of a body frame in space.

    Where the motion is prescribed, items act on the displacements by `push`; `without_push` lists
    items that lack it.
    """

    def evaluate(
        self, y: FloatArray, v: FloatArray, a: FloatArray, c1: float, c2: float,
        s: FloatArray, forms: FloatArray, t: float, work: FrameWork,
    ) -> None:
        """The equations as the sum of what each item adds at the present motion.

        y, v, a (b,): rigid coordinates and multipliers, their rates and second derivatives; c1, c2:
        dv = c1 dy, da = c2 dy; s (3, p): functionals of the displacements u, u', u''; forms (3 g,):
        u.M_g u, u.M_g u', u.M_g u''; t: s; work: arrays for the results, of which `Sums` are views.
        j, o, k of an item: its first functional, coordinate of another body and multiplier.
        """
        out = work.views
        if not isinstance(out, Sums):  # first use of these arrays
            out = work.views = Sums(work, self.size)
        out.clear()
        m = Motion(self.size, y, v, a, c1, c2, t)
        m.elastic = self.elastic
        if self.elastic:
            m.s, m.s1, m.s2, m.forms = *s, forms
            work.tau[3 : self.size] = 0.0  # rows of the attitude, to which `finish` adds torques
        for item, (j, o, k) in zip(self.items, self.starts, strict=True):
            item.evaluate(m, j, o, k, out)
        out.finish(m)

    def arrays(self) -> FrameArrays | None:
        """Equations as a function on arrays, None where an item is not given so."""
        return space_arrays(self.size - 3, self.items, self.starts)

    def drive(
        self, y: FloatArray, v: FloatArray, a: FloatArray, t: float, work: FrameWork
    ) -> None:
        """Loads of the items on the displacements under prescribed motion y, v, a (b,) at t, s, of
        which each item overwrites its own entries in `work.sigma` and `work.coefficients`."""
        out = work.views
        if not isinstance(out, Sums):  # first use of these arrays
            out = work.views = Sums(work, self.size)
        m = Motion(self.size, y, v, a, c1=0.0, c2=0.0, t=t, derivatives=False)
        for item, j in self._items_that_push():
            item.push(m, j, out)

    def drive_along(
        self, y: FloatArray, v: FloatArray, a: FloatArray, times: FloatArray
    ) -> FloatArray:
        """(T, 2 g + p) loads on the displacements under prescribed motion at all times (T,), s, at
        once: as `drive` at each."""
        m = MotionAtTimes(self.size, y, v, a, times)
        out = Pushes(len(times), self.p, self.generators)
        for item, j in self._items_that_push():
            item.push(m, j, out)
        return np.hstack([out.coefficients, out.sigma])

    def _items_that_push(self) -> Iterator[tuple[SpatialItem, int]]:
        """Items with loads on the displacements (`push`), and the number of their first
        functional."""
        for item, (j, _, _) in zip(self.items, self.starts, strict=True):
            if item.pushes:
                yield item, j

    def exact(
        self, v: FloatArray, a: FloatArray, c1: float, c2: float, work: FrameWork
    ) -> None:
        """Derivatives that are quadratic in the displacements u, at the motion of the last
        evaluation."""
        out = work.views
        if isinstance(out, Sums):
            for _, inertia in self.inertias:
                inertia.exact(out.motion, out)
        for item in self.items:
            item.bend(work)

    @property
    def without_push(self) -> tuple[SpatialItem, ...]:
        """Items that act on displacements other than by multipliers, but have no `push`."""
        return tuple(i for i in self.items
                     if i.directions and not i.forces and not i.pushes)

    def time_derivative(self, order: int, t: float, h: float) -> "SpatialFrame | None":
        """Frame with the partial time derivatives (order 1 or 2) of its items' constraints at time
        t, s, by steps of size h, s; None if all are zero."""
        made: list[SpatialItem] = []  # an item without a derivative keeps its place and its numbers
        for i in self.items:
            made.append(i.time_derivative(order, t, h) or Nothing(
                i.directions, i.others, i.forces, isinstance(i, Inertia), i.matrices))
        zero = all(isinstance(i, Nothing) for i in made)
        return None if zero else replace(self, items=tuple(made))


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
        """The equations as the sum of what each item adds, in complex numbers.

        y, v, a (b,): rigid coordinates (x, y, angle) and multipliers, their rates and second
        derivatives; c1, c2: dv = c1 dy, da = c2 dy; s (3, p): functionals of u, u', u'', two of
        which are one complex number; forms (3 g,): u.M_g u, u.M_g u', u.M_g u''. work.fresh: also
        write the derivatives. A function adds to `total`, the sums for the rows of the rigid
        coordinates, and writes its own entries of `out`, those from j, o and k on.
        """
        out = work.views
        if not isinstance(out, Views):  # first use of these arrays
            out = work.views = views(work)
        yl, vl, al = y.tolist(), v.tolist(), a.tolist()
        e = exp(1j * yl[2])
        s0, s1, s2 = s.view("c16").tolist() if self.elastic else ((), (), ())
        # in the order of the fields: keywords would take a tenth of the whole evaluation
        m = PlaneMotion(
            yl, vl, complex(yl[0], yl[1]), e, e.conjugate(), vl[2], al[2], complex(al[0], al[1]),
            c1, c2, t, self.elastic, s0, s1, s2, forms.tolist(), work.fresh)
        total = [0j] * SUMS
        for function, numbers, amplitude, j, o, k in self.evaluated:
            g = 1.0 if amplitude is None else amplitude(t)
            function(numbers, g, m, j, o, k, total, out)
        write(total, work.fresh, out)

    def arrays(self) -> FrameArrays | None:
        """Equations as a function on arrays, None where a part is not compiled (`FUNCTIONS`).

        kinds: positions in `FUNCTIONS`; numbers: constants of each part, zeros behind them; starts:
        first functional, coordinate of another body and multiplier of each item (one part each).
        The last two arguments: all functions to be compiled, each after those it calls, and those
        of parts among them.
        """
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
        """Loads of the items on the displacements under prescribed motion, by `evaluate` at zero
        displacements: its derivatives are a few complex numbers, not worth a second way through the
        items."""
        s, forms = np.zeros((3, self.p)), np.zeros(3 * self.generators)
        self.evaluate(y, v, a, 0.0, 0.0, s, forms, t, work)

    def exact(
        self, v: FloatArray, a: FloatArray, c1: float, c2: float, work: FrameWork
    ) -> None:
        """Derivatives that are quadratic in the displacements u, all in the row of the angle or by
        it (number 2 of y), by dv = c1 dy, da = c2 dy. M_1, M_2: the mass matrix and its product
        with the quarter turn; kappa, mu: factors of M_g u and M_g u' in the elastic rows, with
        derivatives kappa_y, mu_y (b, g) by y; quad (b, 3, g): factors of u.M_g u, u.M_g u', u.M_g
        u'' in rows."""
        w, al = float(v[2]), float(a[2])
        if self.inertias:
            # kappa = (-w^2, al), mu = (0, 2 w); torque al u.M_1 u + 2 w u.M_1 u' - u.M_2 u''
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
