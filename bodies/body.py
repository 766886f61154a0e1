"""What a built body is in the plane and in space alike: its unknowns and fields, and what assembly
asks of it. PlanarBody and SpatialBody add the equations of their frames."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from sparsemor.bodies.body_terms import elastic_term, film_term, thermal_term
from sparsemor.bodies.fields import Elasticity, Heat
from sparsemor.bodies.frame_term import FrameTerm
from sparsemor.bodies.linear_term import LinearTerm
from sparsemor.bodies.separate import heat_body, moving_body
from sparsemor.bodies.table_term import TableTerm, surface_terms
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.layout import Block, FieldName, Layout
from sparsemor.core.mesh import Mesh
from sparsemor.core.model import ProbePlace
from sparsemor.core.notes import Note
from sparsemor.core.protocols import Part, Term, TimeFunction
from sparsemor.core.registry import near
from sparsemor.core.run_header import BodyShape
from sparsemor.core.separable import Amplitude, HeatBody, MovingBody
from sparsemor.core.stage import FrameHistory, SurfaceLoads

NO_NUMBERS = np.zeros(0, np.int64)
KINDS = {2: "plane: give two", 3: "spatial: give three"}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Body(ABC):
    """One body of dimension d.

    X: N reference points, m (body frame), as the dimension's equations have them; mass_matrix
    (N, N) scalar, kg, or None for a rigid body given by numbers; pose: rigid coordinates and
    velocity their rates at the start; moves: False when the frame stays where the pose puts it, or
    follows `guide`: a motion that is given. T0, T_ref (N,) K; thickness (m) makes volumes of areas.
    notes: warnings on its mesh and sets.
    """

    name: str
    X: Any
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
    notes: tuple[Note, ...] = ()

    @property
    @abstractmethod
    def coordinates(self) -> FloatArray:
        """(N, d) reference points, m (body frame)."""

    @abstractmethod
    def frame_terms(self, layout: Layout) -> list[Term]:
        """Inertia, and what else the frame's own coordinates need."""

    @property
    def own_multipliers(self) -> int:
        """Conditions that the frame's coordinates keep by themselves."""
        return 0

    @property
    def idle(self) -> bool:
        """Whether a force on it can do nothing: it neither moves nor deforms."""
        return not self.moves and self.elasticity is None and self.guide is None

    def guided(self, motion: FrameHistory) -> Self:
        """The same body with a frame that follows a given motion and costs no unknowns."""
        return replace(self, moves=False, guide=motion)

    def bare(self) -> Self:
        """The same body without fields: rigid, with the mass and shape that it has."""
        return replace(self, elasticity=None, heat=None)

    # ------------------------------------------------------------------ unknowns

    def blocks(self) -> Sequence[Block]:
        sizes: dict[FieldName, int] = {
            "rigid": len(self.pose) if self.moves else 0,
            "elastic": 0 if self.elasticity is None else len(self.elasticity.free),
            "thermal": 0 if self.heat is None else len(self.heat.free),
            "multiplier": self.own_multipliers if self.moves else 0,
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

    def position(self, layout: Layout, field: str) -> IntArray:
        """Global numbers of one of its blocks (empty when the body does not have it)."""
        name = f"{self.name}.{field}"
        return np.arange(layout.size)[layout[name]] if name in layout else NO_NUMBERS

    # ------------------------------------------------------------------ terms

    def terms(self, layout: Layout, parts: Mapping[str, Part]) -> Sequence[Term]:
        terms = self.frame_terms(layout)
        if self.elasticity is not None:
            terms.append(elastic_term(self, layout, self.elasticity))
        if self.heat is not None:
            terms.append(thermal_term(self, layout, self.heat))
        return terms

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
        """Reducible block name -> node coordinates (n, d) and component (n,) of its unknowns."""
        points, found = self.coordinates, {}
        d = points.shape[1]
        if self.elasticity is not None:
            free = self.elasticity.free
            found[f"{self.name}.elastic"] = (points[free // d], free % d)
        if self.heat is not None:
            found[f"{self.name}.thermal"] = (points[self.heat.free], 0 * self.heat.free)
        return found

    def shape(self) -> BodyShape | None:
        """What a result keeps of it, None for a body without a mesh."""
        if self.mesh is None:
            return None
        e, h = self.elasticity, self.heat
        return BodyShape(self.mesh.points, self.mesh.cells, None if e is None else e.free,
                         None if h is None else h.free, pose=self.pose,
                         given=() if h is None else h.prescribed)

    # ------------------------------------------------------------------ sets and probes

    def named(self, which: str, key: str) -> IntArray:
        """Points of a named set; InputError under `key` that names the sets there are."""
        if which not in self.points:
            raise InputError(f"body {self.name!r} has no set {which!r}: "
                             f"{near(which, sorted(self.points), 'sets')}", key)
        return self.points[which]

    def probe(self, name: str, at: str | Sequence[float]) -> ProbePlace:
        """A material point: the mean of a named set, or the node nearest to body coordinates."""
        weights, point = self._probed(at)
        displacement: FloatArray | None = None
        temperature: FloatArray | None = None
        given: tuple[tuple[float, TimeFunction], ...] = ()
        if self.elasticity is not None:
            every = np.asarray(np.kron(weights[:, None], np.eye(len(point))))
            displacement = every[self.elasticity.free]
        if self.heat is not None:
            temperature = weights[self.heat.free]
            given = tuple((float(weights[n].sum()), f) for n, f in self.heat.prescribed)
        return ProbePlace(name, self.name, point, displacement, temperature, given, self.pose,
                          self.guide)

    def _probed(self, at: str | Sequence[float]) -> tuple[FloatArray, FloatArray]:
        """(N,) weights and (d,) the point, m (body frame)."""
        points, weights = self.coordinates, np.zeros(len(self.X))
        if isinstance(at, str):
            nodes = self.named(at, "at")
            weights[nodes] = 1.0 / len(nodes)
        elif len(at) != points.shape[1]:
            raise InputError(
                f"body {self.name!r} is {KINDS[points.shape[1]]} coordinates", "at")
        elif self.mesh is None:  # a rigid body is the same everywhere
            return weights, np.array(at, dtype=np.float64)
        else:
            weights[np.argmin(np.linalg.norm(points - np.array(at), axis=1))] = 1.0
        return weights, weights @ points
