"""A built spatial body: its numbers, and what joints and loads may ask of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from sparsemor.bodies.body_terms import elastic_term, film_term, thermal_term
from sparsemor.bodies.fields import Elasticity, Heat
from sparsemor.bodies.frame_term import FrameEquations, FrameTerm
from sparsemor.bodies.linear_term import LinearTerm
from sparsemor.bodies.separate import heat_body, moving_body
from sparsemor.bodies.spatial import nodal
from sparsemor.bodies.spatial.attitude import attitude
from sparsemor.bodies.spatial.frame import SpatialFrame
from sparsemor.bodies.spatial.inertia import Inertia
from sparsemor.bodies.spatial.items import Attachment, BodyForce, Item, SpaceForce, UnitLength
from sparsemor.bodies.spatial.terms import inertia_term
from sparsemor.bodies.table_term import TableTerm
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.layout import Block, FieldName, Layout
from sparsemor.core.mesh import Mesh
from sparsemor.core.model import ProbePlace
from sparsemor.core.protocols import Part, Term, TimeFunction
from sparsemor.core.run_header import BodyShape
from sparsemor.core.separable import Amplitude, HeatBody, MovingBody
from sparsemor.core.stage import FrameHistory

NO_NUMBERS = np.zeros(0, np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class SpatialBody:
    """One body in space; rigid coordinates are position (3) and unit quaternion (4), or position
    and angle (1) for a frame that turns about the z axis alone.

    X (N, 3) reference points, m (body frame); inertia: mass and moments about the frame origin, or
    None for a frame without mass; mass_matrix (N, N) scalar, kg, or None for a rigid body given by
    numbers; pose (7 or 4,), velocity its rates at the start; moves: False when the frame stays
    where the pose puts it. T0, T_ref (N,) K.
    """

    name: str
    X: FloatArray
    inertia: Inertia | None
    pose: FloatArray
    velocity: FloatArray
    moves: bool
    points: Mapping[str, IntArray]
    mesh: Mesh | None = None
    mass_matrix: Csr | None = None
    elasticity: Elasticity | None = None
    heat: Heat | None = None
    T0: FloatArray | None = None
    T_ref: FloatArray | None = None

    @property
    def thickness(self) -> float:
        """1: volumes and surfaces of the mesh are those of the body."""
        return 1.0

    @property
    def idle(self) -> bool:
        """Whether a force on it can do nothing: it neither moves nor deforms."""
        return not self.moves and self.elasticity is None

    @property
    def guide(self) -> None:
        """No motion is given to its frame (see `guided`)."""
        return None

    def guided(self, motion: FrameHistory) -> NoReturn:
        """InputError: its frame cannot follow a given motion, as a planar one can."""
        raise InputError(f"body {self.name!r} is in space, and a rigid stage is known for plane "
                         "bodies only: drop rigid_stage, or give the body in the plane")

    @property
    def turns_freely(self) -> bool:
        """Whether its attitude is a quaternion, not an angle about z."""
        return len(self.pose) == 7

    # ------------------------------------------------------------------ unknowns

    def blocks(self) -> Sequence[Block]:
        """The multiplier keeps the quaternion's length."""
        sizes: dict[FieldName, int] = {
            "rigid": len(self.pose) if self.moves else 0,
            "elastic": 0 if self.elasticity is None else len(self.elasticity.free),
            "thermal": 0 if self.heat is None else len(self.heat.free),
            "multiplier": 1 if self.moves and self.turns_freely else 0,
        }
        return [Block(self.name, f, n) for f, n in sizes.items()]

    def initial(self) -> Mapping[str, tuple[FloatArray, FloatArray]]:
        """Block name -> (x, v) at the start: undeformed, at the given pose and temperature."""
        values = {f"{self.name}.rigid": (self.pose, self.velocity)}
        if self.elasticity is not None:
            zero = np.zeros(len(self.elasticity.free))
            values[f"{self.name}.elastic"] = (zero, zero)
        if self.heat is not None and self.T0 is not None:
            T = self.T0[self.heat.free]
            values[f"{self.name}.thermal"] = (T, np.zeros_like(T))
        return values

    # ------------------------------------------------------------------ its own terms

    def terms(self, layout: Layout, parts: Mapping[str, Part]) -> Sequence[Term]:
        terms: list[Term] = []
        if self.inertia is not None and not self.idle:
            terms.append(inertia_term(self, layout, self.inertia))
        if self.moves and self.turns_freely:
            length = self.position(layout, "multiplier")
            terms.append(self.frame_term(layout, UnitLength(), None, length, np.eye(1)))
        if self.elasticity is not None:
            terms.append(elastic_term(self, layout, self.elasticity))
        if self.heat is not None:
            terms.append(thermal_term(self, layout, self.heat))
        return terms

    # ------------------------------------------------------------------ for joints and loads

    def position(self, layout: Layout, field: str) -> IntArray:
        """Global numbers of one of its blocks (empty when the body does not have it)."""
        name = f"{self.name}.{field}"
        return np.arange(layout.size)[layout[name]] if name in layout else NO_NUMBERS

    def frame_term(
        self, layout: Layout, item: Item, vectors: FloatArray | None,
        multipliers: IntArray = NO_NUMBERS, C: FloatArray | None = None,
        other: IntArray = NO_NUMBERS, every: bool = False,
    ) -> FrameTerm:
        """One item with its nodal directions (3 N, directions) as a Term.

        multipliers (l,) global numbers, C (l, forces): constraint rows are C @ the item's rows;
        other: rigid coordinates of the other body that the item reads. every: keep all elastic
        unknowns as rows and columns, not only those the vectors touch.
        """
        e = self.elasticity
        frame = SpatialFrame((item,), e is not None, len(self.pose))
        P = np.zeros((0, 0)) if e is None or vectors is None else vectors[e.free]
        used = np.arange(len(P)) if every else np.flatnonzero(np.any(P != 0, axis=1))
        rigid, el = self.position(layout, "rigid"), self.position(layout, "elastic")[used]
        at = np.sort(np.concatenate([rigid, other, el, multipliers]))
        own, read, mine, lam = (np.searchsorted(at, n) for n in (rigid, other, el, multipliers))
        Y, y0, d = np.zeros((frame.border, len(at))), np.zeros(frame.border), frame.rigid_size
        Y[np.arange(len(own)), own] = 1.0
        Y[len(self.pose) + np.arange(len(read)), read] = 1.0
        if not self.moves:
            y0[: len(self.pose)] = self.pose
        if C is not None:
            Y[d:, lam] = C.T
        D, W = np.zeros((frame.p, len(at))), np.zeros((len(at), frame.p))
        if frame.p:
            D[:, mine], W[mine] = P[used].T, P[used]
        return FrameTerm(self.name, at, at, FrameEquations(frame, Y, y0, D, (), Y.T.copy(), W, ()))

    def space_force(
        self, layout: Layout, weights: FloatArray, force: FloatArray, amplitude: Amplitude
    ) -> FrameTerm:
        """Nodal weights (N,) times one force (3,) (N per unit weight) in space axes."""
        item = SpaceForce(float(weights.sum()), weights @ self.X, force, amplitude)
        return self.frame_term(layout, item, nodal.along(weights))

    def gravity(self, layout: Layout, g: FloatArray, amplitude: Amplitude) -> Sequence[FrameTerm]:
        """Weight of the deformed body: nodal masses times g (3,), m/s^2."""
        if self.inertia is None:
            return ()
        item = SpaceForce(self.inertia.mass, self.inertia.moment, g, amplitude)
        m = self.mass_matrix
        vectors = None if m is None else nodal.along(np.asarray(m.sum(axis=1)).ravel())
        return (self.frame_term(layout, item, vectors),)

    def body_force(self, layout: Layout, forces: FloatArray, amplitude: Amplitude) -> FrameTerm:
        """Nodal forces (N, 3) that turn with the body frame, N."""
        item = BodyForce(forces.sum(axis=0), np.cross(self.X, forces).sum(axis=0), amplitude)
        return self.frame_term(layout, item, nodal.with_torques(forces))

    def attachment(self, weights: FloatArray) -> tuple[Attachment, FloatArray]:
        """The mean point of the weighted nodes, with its nodal directions (3 N, 3)."""
        return Attachment(weights @ self.X), nodal.along(weights)

    def heat_term(
        self, layout: Layout, vector: FloatArray, amplitude: Amplitude, film: Csr | None = None
    ) -> LinearTerm:
        """Nodal heat vector (N,) W times an amplitude, and a film matrix (N, N) W/K."""
        assert self.heat is not None
        return film_term(self.name, self.position(layout, "thermal"), self.heat, vector, amplitude,
                         film)

    # ------------------------------------------------------------------ for assembly

    def claims(self, layout: Layout, term: Term) -> bool:
        """Whether `mechanics` or `heat_equations` accounts for this term."""
        if isinstance(term, FrameTerm | LinearTerm | TableTerm):
            return term.body == self.name
        at = self.position(layout, "thermal")
        inside = [len(r) and len(at) and r.min() >= at[0] and r.max() <= at[-1]
                  for r in (term.rows, term.columns)]
        return all(inside)

    def mechanics(self, layout: Layout, terms: Sequence[Term]) -> MovingBody | None:
        return moving_body(self, layout, terms)

    def heat_equations(self, layout: Layout, terms: Sequence[Term]) -> HeatBody | None:
        return heat_body(self, layout, terms)

    def geometry(self) -> Mapping[str, tuple[FloatArray, IntArray]]:
        """Reducible block name -> node coordinates (n, 3) and component (n,) of its unknowns."""
        found = {}
        if self.elasticity is not None:
            free = self.elasticity.free
            found[f"{self.name}.elastic"] = (self.X[free // 3], free % 3)
        if self.heat is not None:
            found[f"{self.name}.thermal"] = (self.X[self.heat.free], 0 * self.heat.free)
        return found

    def shape(self) -> BodyShape | None:
        """What a result keeps of it, None for a body without a mesh."""
        if self.mesh is None:
            return None
        e, h = self.elasticity, self.heat
        held = None if h is None or not h.prescribed else self.T0
        if held is not None and h is not None:
            held = held.copy()
            for nodes, function in h.prescribed:
                held[nodes] = function.value(0.0)
        return BodyShape(self.mesh.points, self.mesh.cells, None if e is None else e.free,
                         None if h is None else h.free, None, held)

    def probe(self, name: str, at: str | Sequence[float]) -> ProbePlace:
        """A material point: the mean of a named set, or the node nearest to body coordinates."""
        weights, point = self._probed(at)
        displacement = temperature = None
        given: tuple[tuple[float, TimeFunction], ...] = ()
        if self.elasticity is not None:
            displacement = nodal.along(weights)[self.elasticity.free]
        if self.heat is not None:
            temperature = weights[self.heat.free]
            given = tuple((float(weights[n].sum()), f) for n, f in self.heat.prescribed)
        return ProbePlace(name, self.name, point, displacement, temperature, given, self.pose)

    def _probed(self, at: str | Sequence[float]) -> tuple[FloatArray, FloatArray]:
        weights = np.zeros(len(self.X))
        if isinstance(at, str):
            if at not in self.points:
                raise InputError(f"body {self.name!r} has no set {at!r}; it has "
                                 f"{', '.join(sorted(self.points)) or 'none'}", "at")
            weights[self.points[at]] = 1.0 / len(self.points[at])
        elif len(at) != 3:
            raise InputError(f"body {self.name!r} is spatial: give three coordinates", "at")
        elif self.mesh is None:  # a rigid body is the same everywhere
            return weights, np.array(at, dtype=np.float64)
        else:
            weights[np.argmin(np.linalg.norm(self.X - np.array(at), axis=1))] = 1.0
        return weights, weights @ self.X

    # ------------------------------------------------------------------ where points are

    def start_rotation(self) -> FloatArray:
        """(3, 3): body axes to space axes at the start."""
        return attitude(self.pose[3:]).A

    def start_position(self, weights: FloatArray) -> FloatArray:
        """(3,) global position of the weighted mean point at the start, m."""
        return np.asarray(self.pose[:3] + self.start_rotation() @ (weights @ self.X))
