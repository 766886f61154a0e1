"""Contact of a scene: its term in the equations of a time step, and its loads and resultants along
a prescribed motion."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.bodies.contact.along_prescribed_motion import (
    Motion,
    Path,
    Window,
    chatter_warning,
    relative_motion,
    steps,
    windows,
)
from sparsemor.bodies.contact.bristles import BRISTLES, Bristles
from sparsemor.bodies.contact.closest_points import nearest
from sparsemor.bodies.contact.contact_term import ContactTerm
from sparsemor.bodies.contact.contact_unknowns import ContactSide
from sparsemor.bodies.contact.overlaps import pressure
from sparsemor.bodies.contact.quadrature import PRESCRIBED, points_along, rule
from sparsemor.bodies.contact.surface import BroadPhase, Surface
from sparsemor.bodies.contact.tractions import ContactLoads, Interface, names_of, nodal, resultants
from sparsemor.core import (
    Block,
    Contact,
    Equations,
    FloatArray,
    InputError,
    IntArray,
    SurfaceLoads,
)

FLAT = 1e-3
"""Fraction of a surface's extent below which it counts as flat in a direction."""
PASSAGE = 5.0
"""Smallest admissible number of steps during which a point lies under the shorter surface."""


@dataclass(frozen=True, slots=True, eq=False)
class ContactPart(Contact):
    """Contact of two surfaces, in the plane or in space.

    reach: largest admissible penetration, m; deforms: surfaces move with the displacements; heats:
    friction heat and conduction enter the bodies that have temperatures.
    """

    name: str
    first: Surface
    second: Surface
    face: Interface
    near: BroadPhase
    reach: float
    deforms: bool
    heats: bool
    bristles: Bristles | None = None
    localized: bool = True
    moving: bool = True

    def blocks(self) -> Sequence[Block]:
        """The deflections of its bristles."""
        b = self.bristles
        return () if b is None else (Block(self.name, BRISTLES, b.count * self.first.d),)

    # ------------------------------------------------------------------ inside the step

    def contribute(self, equations: Equations) -> None:
        """Adds the contact term to the equations."""
        first, second = (
            ContactSide.from_surface(
                s, equations.layout, moves=True, deforms=self.deforms, conducts=self.heats)
            for s in (self.first, self.second))
        self._write(equations, (first, second), self.face, self.deforms, self.bristles)

    def conduction(self, equations: Equations, motion: Motion) -> None:
        """Adds conduction between surfaces whose frames have a prescribed motion, without friction.
        """
        if self.face.conductance == 0:
            return
        first, second = (
            ContactSide.from_surface(
                s, equations.layout, moves=False, deforms=False, conducts=True,
                motion=motion.get(s.body.name)) for s in (self.first, self.second))
        self._write(
            equations, (first, second), replace(self.face, friction=None), deforms=False)

    def _write(
        self, equations: Equations, sides: tuple[ContactSide, ContactSide], face: Interface,
        deforms: bool, bristles: Bristles | None = None,
    ) -> None:
        """Adds the term to the blocks of unknowns on which it depends and acts; nothing if it acts
        on no unknown. deflections: numbers of the bristles' unknowns, none without bristles;
        together: solved with all other unknowns by Newton's method, as deformable surfaces are
        stiff; near, reach: search for close facets, largest admissible penetration, m."""
        deflections = equations.numbers(f"{self.name}.{BRISTLES.name}" if bristles else "")
        term = ContactTerm.between(
            sides, face, self.near, deforms, self.reach, bristles, deflections)
        if len(term.rows):
            blocks = equations.layout.containing(np.concatenate([term.rows, term.columns]))
            equations.local(blocks, term, together=deforms)

    # ------------------------------------------------------------------ along a prescribed motion

    def imported(self, motion: Motion) -> Mapping[str, SurfaceLoads]:
        """Body name -> nodal contact forces in its own axes (N) and nodal friction heat (W) at each
        time of the motion. `_loads` has them window by window of times, as forces (M, 2 d, d), in
        the second body's axes, and heats (M, 2 d) on the corners of both facets.

        In space, where surfaces have many nodes, only nodes that are in contact at some time are
        included (all nodes, if none is). _prescribed_face: laws of the contact without conduction,
        with more quadrature points. InputError with bristles, which have a history.
        """
        if self.bristles is not None:
            raise InputError("this law sticks, by a state of the surfaces that no motion tells: "
                             "drop rigid_stage, with `surfaces: deformed` for bodies that deform, "
                             "or take `coulomb`", f"contacts.{self.name}.friction")
        face, d = self._prescribed_face(), self.first.d
        made = _Sums(self.first), _Sums(self.second)
        for w, loads in self._loads(motion, face):
            nodes, time = w.nodes[w.pieces.overlap], w.time[w.pieces.overlap]
            heat = loads.heat if self.heats else 0.0 * loads.heat
            for side, ends in enumerate((slice(0, d), slice(d, 2 * d))):
                made[side].add(w.times, time, nodes[:, ends], loads.force[:, ends], heat[:, ends])
        found = {}
        for side, surface in enumerate((self.first, self.second)):
            touched, force, heat = made[side].loads()
            if side == 0:
                force = self._in_first(force, motion)
            found[surface.body.name] = SurfaceLoads(surface.nodes[touched], force, heat)
        return found

    def _prescribed_face(self) -> Interface:
        """The interface without conduction, in the plane with at least `PRESCRIBED` points a piece:
        loads along a motion are computed once."""
        d, n = self.first.d, points_along(self.first.d, self.face.points)
        points, weights = rule(d, max(PRESCRIBED, n) if d == 2 else n)
        return replace(self.face, conductance=0.0, points=points, weights=weights)

    def _in_first(self, force: FloatArray, motion: Motion) -> FloatArray:
        """(T, j, d) forces in the first body's axes, from forces in the second body's axes."""
        A, B = (Path(s, motion).A for s in (self.first, self.second))
        return np.asarray(force @ (B.transpose(0, 2, 1) @ A))

    def history(self, motion: Motion) -> Mapping[str, FloatArray]:
        """Resultants (T,) of the contact at the times of the motion, by the names of `names_of`."""
        found = {name: np.zeros(steps(motion)) for name in names_of(self.first.d)}
        for w, loads in self._loads(motion, self.face):
            now = resultants(w.times, w.time, w.overlaps, w.pieces, loads, self.face)
            for name, values in now.items():
                found[name][w.begin : w.stop] = values
        return found

    def _loads(self, motion: Motion, face: Interface) -> Iterator[tuple[Window, ContactLoads]]:
        """Contact in each window of times, with nodal forces and friction heat."""
        for w in windows(self.first, self.second, self.near, face, motion):
            yield w, nodal(w.overlaps, w.pieces, face, T=None)

    # ------------------------------------------------------------------ warnings after a run

    def missed(self, motion: Motion) -> str:
        """Warning if the surfaces never touched; "" otherwise."""
        gap = 0.0 if self._pressed(motion) else self._closest(motion)
        if gap <= (self.reach if self.deforms else 0.0):
            return ""
        one, other = self.first.body.name, self.second.body.name
        return (f"contact {self.name}: the surfaces of {one} and {other} never met; the nearest "
                f"they came is {gap:.3g} m: check the poses, and that the sets name the sides that "
                "face each other")

    def chatter_warning(self, history: Mapping[str, FloatArray]) -> str:
        """Warning if the normal force in the contact's history oscillates from step to step; ""
        otherwise."""
        return chatter_warning(self.name, history["normal"])

    def passage(self, motion: Motion) -> str:
        """Warning if a point lies under the shorter surface for fewer than `PASSAGE` steps; ""
        otherwise. at: node positions of both surfaces at a time.

        Number of steps of a passage: extent of that surface along the relative motion of one step,
        divided by that motion; the minimum over 50 of the times.
        """
        count, at = steps(motion), self._points(motion)
        fewest = np.inf
        for k in np.unique(np.linspace(0, count - 2, 50).astype(int)) if count > 1 else ():
            before, after = at(slice(k, k + 1)), at(slice(k + 1, k + 2))
            fewest = min(fewest, _passage(before, after))
        if fewest >= PASSAGE:
            return ""
        return (f"contact {self.name}: a point lies under the shorter surface for {fewest:.2g} "
                f"steps only, too few for its pressure and heat (at least {PASSAGE:g}): take a "
                f"time.step {np.ceil(PASSAGE / fewest):g} times as small")

    def _pressed(self, motion: Motion) -> bool:
        """True if there is pressure at any of the times."""
        return any((pressure(w.overlaps, w.pieces.of, w.pieces.parts.corners, self.face.normal)
                    > 0).any() for w in windows(self.first, self.second, self.near, self.face,
                                                motion))

    def _points(self, motion: Motion) -> Callable[[slice], tuple[FloatArray, FloatArray]]:
        """Function of one time index (a slice): node positions (n1, d) and (n2, d), m, in the
        second body's axes."""
        one, other = Path(self.first, motion), Path(self.second, motion)
        return lambda now: (relative_motion(one, other, self.first.X, now)[0][0], self.second.X)

    def _closest(self, motion: Motion) -> float:
        """Smallest distance of a node of either surface from the other surface, m, over 100 of the
        times."""
        found, at = np.inf, self._points(motion)
        for k in np.unique(np.linspace(0, steps(motion) - 1, 100).astype(int)):
            a, b = at(slice(k, k + 1))
            for z, corners in ((a, b[self.second.facets]), (b, a[self.first.facets])):
                found = min(found, float(nearest(z, corners).distance.min()))
        return found


def _passage(
    before: tuple[FloatArray, FloatArray], after: tuple[FloatArray, FloatArray]
) -> float:
    """Number of steps of a passage: extent of the shorter surface along the tangential relative
    motion of one step, divided by that motion; infinite without tangential motion.

    before, after: node positions of both surfaces, m, at the start and end of the step, in the axes
    of one body. The motion is the median over the nodes of the shorter surface, relative to the
    nearest node of the other one.
    """
    short, other = sorted((0, 1), key=lambda i: float(np.ptp(before[i], axis=0).max()))
    near = cKDTree(before[other]).query(before[short])[1]
    # relative to the nearest node, projected on the directions in which the surface is not flat:
    # its extent there is more than FLAT of the largest
    moved = np.median((after[short] - before[short]) - (after[other] - before[other])[near], axis=0)
    sizes, axes = np.linalg.svd(before[short] - before[short].mean(axis=0), full_matrices=False)[1:]
    flat = axes[sizes > FLAT * sizes[0]]
    along = flat.T @ (flat @ moved)
    length = float(np.linalg.norm(along))
    extent = float(np.ptp(before[short] @ along)) / length if length > 0.0 else 0.0
    return extent / length if extent > 0.0 else float(np.inf)


class _Sums:
    """Loads on the nodes of a surface, collected over successive windows of times; each window has
    only the nodes in contact in it. touched: these nodes, for each window; values (times, nodes, d
    + 1): force and heat on them. In the plane, where surfaces have few nodes, or without contact,
    `loads` has all n nodes."""

    def __init__(self, surface: Surface) -> None:
        self.n, self.d = len(surface.nodes), surface.d
        self.touched: list[IntArray] = []
        self.values: list[FloatArray] = []

    def add(
        self, times: int, time: IntArray, nodes: IntArray, force: FloatArray, heat: FloatArray
    ) -> None:
        """Adds the loads of the next `times` times, a window: time (M,), counted from its first
        one, nodes (M, d), force (M, d, d), N, heat (M, d), W, of M pieces on the corners of their
        facets.
        """
        touched, at = np.unique(nodes, return_inverse=True)
        at = (time[:, None] * len(touched) + at.reshape(nodes.shape)).ravel()  # (time, node)
        columns = [*force.reshape(-1, self.d).T, heat.ravel()]
        size = times * len(touched)
        whole: FloatArray = np.array([np.bincount(at, c, size) for c in columns]).T
        self.touched.append(touched)
        self.values.append(np.asarray(whole).reshape(times, len(touched), self.d + 1))

    def loads(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Nodes (j,), forces (T, j, d), N, and heats (T, j), W, over all times."""
        ever = np.unique(np.concatenate(self.touched))
        if self.d == 2 or not len(ever):
            ever = np.arange(self.n)
        times = sum(len(v) for v in self.values)
        made, begin = np.zeros((times, len(ever), self.d + 1)), 0
        for touched, values in zip(self.touched, self.values, strict=True):
            made[begin : begin + len(values), np.searchsorted(ever, touched)] = values
            begin += len(values)
        return ever, made[:, :, :-1].copy(), made[:, :, -1].copy()
