"""A built planar body: its numbers, and what joints and loads may ask of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sparsemor.bodies.body_terms import elastic_term, film_term, inertia_term, thermal_term
from sparsemor.bodies.fields import Elasticity, Heat
from sparsemor.bodies.frame_term import FrameEquations, FrameTerm
from sparsemor.bodies.linear_term import LinearTerm
from sparsemor.bodies.planar.frame import PlanarFrame
from sparsemor.bodies.planar.items import Attachment, BodyForce, Item, SpaceForce
from sparsemor.bodies.separate import heat_body, moving_body
from sparsemor.bodies.table_term import TableTerm, surface_terms
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.layout import Block, FieldName, Layout
from sparsemor.core.mesh import Mesh
from sparsemor.core.model import ProbePlace
from sparsemor.core.protocols import Part, Term, TimeFunction
from sparsemor.core.run_header import BodyShape
from sparsemor.core.separable import Amplitude, HeatBody, MovingBody
from sparsemor.core.stage import FrameHistory, SurfaceLoads


@dataclass(frozen=True, slots=True, eq=False)
class PlanarBody:
    """One body in the plane.

    X (N,) complex reference points, m (body frame); mass_matrix (N, N) scalar, kg, or None for a
    rigid body given by numbers; pose (R_x, R_y, theta), velocity its rates at the start;
    moves: False when the frame stays where the pose puts it, or follows `guide`: a motion that is
    given. T0, T_ref (N,) K.
    """

    name: str
    X: Any
    mass: float
    moment: complex
    inertia: float
    pose: FloatArray
    velocity: FloatArray
    moves: bool
    points: Mapping[str, IntArray]
    mesh: Mesh | None = None
    thickness: float = 1.0
    mass_matrix: Csr | None = None
    elasticity: Elasticity | None = None
    heat: Heat | None = None
    T0: FloatArray | None = None
    T_ref: FloatArray | None = None
    guide: FrameHistory | None = None

    @property
    def idle(self) -> bool:
        """Whether a force on it can do nothing: it neither moves nor deforms."""
        return not self.moves and self.elasticity is None and self.guide is None

    def guided(self, motion: FrameHistory) -> "PlanarBody":
        """The same body with a frame that follows a given motion and costs no unknowns."""
        return replace(self, moves=False, guide=motion)

    # ------------------------------------------------------------------ unknowns

    def blocks(self) -> Sequence[Block]:
        sizes: dict[FieldName, int] = {
            "rigid": 3 if self.moves else 0,
            "elastic": 0 if self.elasticity is None else len(self.elasticity.free),
            "thermal": 0 if self.heat is None else len(self.heat.free),
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
        if self.moves or self.elasticity is not None:
            terms.append(inertia_term(self, layout))
        if self.elasticity is not None:
            terms.append(elastic_term(self, layout, self.elasticity))
        if self.heat is not None:
            terms.append(thermal_term(self, layout, self.heat))
        return terms

    # ------------------------------------------------------------------ for joints and loads

    def position(self, layout: Layout, field: str) -> IntArray:
        """Global numbers of one of its blocks (empty when the body does not have it)."""
        name = f"{self.name}.{field}"
        return np.arange(layout.size)[layout[name]] if name in layout else np.zeros(0, np.int64)

    def frame_term(
        self, layout: Layout, item: Item, vectors: Sequence[Any],
        multipliers: IntArray | None = None, C: FloatArray | None = None, every: bool = False,
    ) -> FrameTerm:
        """One item with its complex nodal vectors (N,), one a pair, as a Term.

        multipliers (l,) global numbers, C (l, forces): constraint rows are C @ attachment rows.
        every: keep all elastic unknowns as rows and columns, not only those the vectors touch.
        """
        elastic = self.elasticity is not None
        frame = PlanarFrame((item,), elastic)
        free = self.elasticity.free if self.elasticity is not None else np.zeros(0, np.int64)
        pairs = [np.stack([f, 1j * f], axis=1) for f in vectors] if elastic else []
        P = np.concatenate(pairs, axis=1) if pairs else np.zeros((len(self.X), 0), complex)
        P = np.stack([P.real, P.imag], axis=1).reshape(2 * len(self.X), P.shape[1])[free]
        used = np.arange(len(free)) if every else np.flatnonzero(np.any(P != 0, axis=1))
        rigid, el = self.position(layout, "rigid"), self.position(layout, "elastic")[used]
        lam = np.zeros(0, np.int64) if multipliers is None else multipliers
        C = np.zeros((0, item.forces)) if C is None else C
        at = np.concatenate([rigid, el, lam])
        r, e = len(rigid), len(used)
        Y, y0 = np.zeros((frame.border, len(at))), np.zeros(frame.border)
        Y[:r, :r] = np.eye(r)
        if not self.moves and self.guide is None:
            y0[:3] = self.pose
        Y[3:, r + e :] = C.T
        D, W = np.zeros((P.shape[1], len(at))), np.zeros((len(at), P.shape[1]))
        D[:, r : r + e], W[r : r + e] = P[used].T, P[used]
        return FrameTerm(self.name, at, at, FrameEquations(
            frame, Y, y0, D, (), Y.T.copy(), W, (), self.guide))

    def space_force(
        self, layout: Layout, weights: FloatArray, force: complex, amplitude: Amplitude,
        arm: complex | None = None,
    ) -> FrameTerm:
        """Nodal weights (N,) times one force (N per unit weight) in space axes."""
        arm = complex(weights @ self.X) if arm is None else arm
        item = SpaceForce(float(weights.sum()), arm, force, amplitude)
        return self.frame_term(layout, item, (weights.astype(complex),))

    def gravity(self, layout: Layout, g: complex, amplitude: Amplitude) -> FrameTerm:
        """Weight of the deformed body: nodal masses times g (m/s^2)."""
        item = SpaceForce(self.mass, self.moment, g, amplitude)
        m = self.mass_matrix
        weights = () if m is None else (np.asarray(m.sum(axis=1), dtype=complex),)
        return self.frame_term(layout, item, weights)

    def body_force(self, layout: Layout, forces: Any, amplitude: Amplitude) -> FrameTerm:
        """Complex nodal forces (N,) that turn with the body frame, N."""
        item = BodyForce(complex(forces.sum()), complex(np.vdot(forces, self.X)), amplitude)
        return self.frame_term(layout, item, (forces,))

    def attachment(self, weights: FloatArray, turns: bool) -> tuple[Attachment, tuple[Any, ...]]:
        """The mean point of the weighted nodes, with its complex direction vectors."""
        point = complex(weights @ self.X)
        vectors: tuple[Any, ...] = (weights.astype(complex),)
        if turns:
            arm = self.X - point
            size = float(weights @ np.abs(arm) ** 2)
            # least-squares rotation of the set: sum w (i arm) . u / sum w |arm|^2
            vectors += (weights * 1j * arm / size if size > 0 else np.zeros_like(self.X),)
        return Attachment(point, turns), vectors

    def heat_term(
        self, layout: Layout, vector: FloatArray, amplitude: Amplitude, film: Csr | None = None
    ) -> LinearTerm:
        """Nodal heat vector (N,) W times an amplitude, and a film matrix (N, N) W/K."""
        assert self.heat is not None
        return film_term(self.name, self.position(layout, "thermal"), self.heat, vector, amplitude,
                         film)

    def surface_loads(
        self, layout: Layout, source: str, loads: SurfaceLoads, times: FloatArray
    ) -> Sequence[Term]:
        """What moves over its surface, at times (T,), s, as terms of each of its fields."""
        return surface_terms(self, layout, source, loads, times)

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
        """Reducible block name -> node coordinates (n, 2) and component (n,) of its unknowns."""
        points = np.stack([self.X.real, self.X.imag], axis=1)
        found = {}
        if self.elasticity is not None:
            free = self.elasticity.free
            found[f"{self.name}.elastic"] = (points[free // 2], free % 2)
        if self.heat is not None:
            found[f"{self.name}.thermal"] = (points[self.heat.free], 0 * self.heat.free)
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
            rows = np.zeros((2 * len(self.X), 2))
            rows[0::2, 0] = rows[1::2, 1] = weights
            displacement = rows[self.elasticity.free]
        if self.heat is not None:
            temperature = weights[self.heat.free]
            given = tuple((float(weights[n].sum()), f) for n, f in self.heat.prescribed)
        return ProbePlace(name, self.name, np.array([point.real, point.imag]), displacement,
                          temperature, given, self.pose, self.guide)

    def _probed(self, at: str | Sequence[float]) -> tuple[FloatArray, complex]:
        weights = np.zeros(len(self.X))
        if isinstance(at, str):
            if at not in self.points:
                raise InputError(f"body {self.name!r} has no set {at!r}; it has "
                                 f"{', '.join(sorted(self.points)) or 'none'}", "at")
            weights[self.points[at]] = 1.0 / len(self.points[at])
        elif self.mesh is None:  # a rigid body is the same everywhere
            return weights, complex(at[0], at[1])
        else:
            weights[np.argmin(np.abs(self.X - complex(at[0], at[1])))] = 1.0
        return weights, complex(weights @ self.X)

    # ------------------------------------------------------------------ where points are

    def start_position(self, weights: FloatArray) -> complex:
        """Global position of the weighted mean point at the start, m."""
        turn = np.exp(1j * self.pose[2])
        return complex(self.pose[0] + 1j * self.pose[1] + turn * (weights @ self.X))
