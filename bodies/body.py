"""Body of a scene, in the plane or in space: unknowns, fields, equations, and the interface for
joints, loads and contacts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Self

import numpy as np

from sparsemor.bodies.fem.bending import bending_notes
from sparsemor.bodies.fem.element_balance import elastic_integrals, heat_integrals
from sparsemor.bodies.fem.fields import Elasticity, Heat
from sparsemor.bodies.fem.pointwise_law import PointwiseLaw
from sparsemor.bodies.fem.stress_stiffness import stress_stiffness
from sparsemor.bodies.frames import nodal
from sparsemor.bodies.frames.force_items import BodyForce, SpaceForce
from sparsemor.bodies.frames.frame import SpatialFrame
from sparsemor.bodies.frames.inertia import Inertia
from sparsemor.bodies.frames.items import UnitLength
from sparsemor.bodies.frames.joint_items import Attachment
from sparsemor.bodies.frames.moments import MassProperties, moments_of
from sparsemor.bodies.frames.plane import PlanarFrame
from sparsemor.bodies.frames.rotation import torque
from sparsemor.bodies.mesh.centres import Centre, centre_of_set
from sparsemor.bodies.mesh.sets import PointSet
from sparsemor.bodies.terms.body_terms import (
    write_conduction,
    write_elasticity,
    write_film,
    write_law,
)
from sparsemor.bodies.terms.field_kinds import ELASTIC, MULTIPLIER, RIGID, THERMAL
from sparsemor.bodies.terms.inertia import directions, generator
from sparsemor.bodies.terms.surface_loads import write_surface_loads
from sparsemor.core import (
    FREE_POSE,
    PLANAR_POSE,
    Amplitude,
    Block,
    BodyFrame,
    BodyShape,
    Csr,
    Equations,
    FloatArray,
    FrameHistory,
    FrameItem,
    InputError,
    IntArray,
    Layout,
    Mesh,
    Note,
    ProbePlace,
    StressStiffness,
    SurfaceLoads,
    TimeFunction,
    points_in_space,
    suggestions,
    vectors_in_space,
)

NO_NUMBERS = np.zeros(0, np.int64)
KINDS = {2: "plane: give two", 3: "spatial: give three"}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Body:
    """One body in d dimensions.

    X (N, d): reference points, m (body frame). pose: initial rigid coordinates, and velocity their
    rates: position and angle (3) in the plane; in space position and unit quaternion (7), or
    position and angle (4) for a frame that rotates about the z axis alone. inertia: mass and
    moments about the frame origin, None for a massless frame; mass_matrix (N, N): scalar, kg, None
    for a rigid body without mesh. moves: True if the rigid coordinates are unknowns; otherwise the
    frame is fixed, or follows the prescribed motion `guide`. points: set -> numbers of its points;
    centres: set -> its centre (d,), m, where the scene gives it; declared: sets of the scene. T0,
    T_ref (N,): initial and stress-free temperature, K; thickness, m, of a planar body.
    temperature_limits: property -> temperatures, K, between which it is defined. mesh_notes:
    warnings about its mesh and sets. without_fields: True for a rigid copy of a body that has
    fields. kernel: class that evaluates its frame equations.
    """

    name: str
    X: FloatArray
    inertia: MassProperties | None
    pose: FloatArray
    velocity: FloatArray
    moves: bool
    points: Mapping[str, IntArray]
    centres: Mapping[str, FloatArray] = field(default_factory=dict)
    declared: Mapping[str, PointSet] = field(default_factory=dict)
    mesh: Mesh | None = None
    thickness: float = 1.0
    mass_matrix: Csr | None = None
    elasticity: Elasticity | None = None
    heat: Heat | None = None
    T0: FloatArray | None = None
    T_ref: FloatArray | None = None
    guide: FrameHistory | None = None
    temperature_limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    mesh_notes: tuple[Note, ...] = ()
    without_fields: bool = False
    _found: dict[str, tuple[Note, ...]] = field(init=False, default_factory=dict)
    kernel: type[PlanarFrame] | type[SpatialFrame] = field(init=False)

    def __post_init__(self) -> None:
        plane = len(self.pose) == PLANAR_POSE
        object.__setattr__(self, "kernel", PlanarFrame if plane else SpatialFrame)

    @property
    def d(self) -> int:
        """Dimension: 2 or 3."""
        return int(self.X.shape[1])

    @property
    def turns_freely(self) -> bool:
        """True if its attitude is a quaternion, not an angle."""
        return len(self.pose) == FREE_POSE

    @property
    def notes(self) -> tuple[Note, ...]:
        """Warnings about its mesh, sets and bending stiffness."""
        if "bending" not in self._found:
            e, mesh = self.elasticity, self.mesh
            self._found["bending"] = () if e is None or mesh is None else tuple(
                bending_notes(self.name, mesh, e, self.thickness))
        return (*self.mesh_notes, *self._found["bending"])

    @property
    def immobile(self) -> bool:
        """True if a force on the body has no effect: it neither moves nor deforms."""
        return not self.moves and self.elasticity is None and self.guide is None

    def with_motion(self, motion: FrameHistory) -> Self:
        """Copy whose frame follows a prescribed motion and has no unknowns."""
        return replace(self, moves=False, guide=motion)

    def rigid_copy(self) -> Self:
        """Copy without fields: a rigid body with the same mass and shape."""
        return replace(self, elasticity=None, heat=None, without_fields=True)

    # ------------------------------------------------------------------ unknowns

    def blocks(self) -> Sequence[Block]:
        sizes = {
            RIGID: len(self.pose) if self.moves else 0,
            ELASTIC: 0 if self.elasticity is None else len(self.elasticity.free),
            THERMAL: 0 if self.heat is None else len(self.heat.free),
            MULTIPLIER: 1 if self.moves and self.turns_freely else 0,  # of the quaternion's length
        }
        return [Block(self.name, kind, n) for kind, n in sizes.items()]

    def initial(self) -> Mapping[str, tuple[FloatArray, FloatArray]]:
        """Block name -> initial values (x, v): undeformed, at the given pose and temperature."""
        values = {f"{self.name}.rigid": (self.pose, self.velocity)}
        if self.elasticity is not None:
            zero = np.zeros(len(self.elasticity.free))
            values[f"{self.name}.elastic"] = (zero, zero)
        if self.heat is not None and self.T0 is not None:
            T = self.T0[self.heat.free]
            values[f"{self.name}.thermal"] = (T, np.zeros_like(T))
        return values

    def position(self, layout: Layout, field: str) -> IntArray:
        """Global numbers of the unknowns of one of its blocks (empty if the body does not have it).
        """
        name = f"{self.name}.{field}"
        return np.arange(layout.size)[layout[name]] if name in layout else NO_NUMBERS

    # ------------------------------------------------------------------ equations

    def contribute(self, equations: Equations) -> None:
        if self.heat is not None and self.heat.prescribed and equations.stepping is not None:
            given = tuple((n, equations.stepping.prescribed(f)) for n, f in self.heat.prescribed)
            replace(self, heat=replace(self.heat, prescribed=given))._contribute(equations)
        else:
            self._contribute(equations)

    def _contribute(self, equations: Equations) -> None:
        mesh = self.mesh is not None
        equations.body(
            self.frame_of, self.pose, moves=self.moves, guide=self.guide,
            elastic_integrals=partial(elastic_integrals, self) if mesh else None,
            heat_integrals=partial(heat_integrals, self) if mesh else None,
            stress_stiffness=None if self.elasticity is None or not mesh else StressStiffness(
                partial(stress_stiffness, self), self.elasticity.nonlinear))
        if self.moves or self.elasticity is not None:
            self._write_inertia(equations)
        if self.moves and self.turns_freely:
            self.frame_item(equations, UnitLength(), None,
                            multipliers=f"{self.name}.multiplier", C=np.eye(1))
        if self.elasticity is not None:
            write_elasticity(self, equations, self.elasticity)
        if self.heat is not None:
            write_conduction(self, equations, self.heat)

    def _write_inertia(self, equations: Equations) -> None:
        """Adds the inertia of the rigid and elastic unknowns; nothing for a massless frame."""
        if self.inertia is None:
            return
        moments = moments_of(len(self.pose))
        item = Inertia.of(self.inertia, moments)
        if self.elasticity is None or self.mass_matrix is None:
            self.frame_item(equations, item, None)
            return
        m, F = self.mass_matrix, self.elasticity.free
        self.frame_item(equations, item, directions(m, self.X, moments.B), generators=[
            generator(m, B)[F][:, F] for B in moments.B])

    def frame_of(self, items: Sequence[Any]) -> BodyFrame:
        """Frame equations as the sum of the given items."""
        return self.kernel(tuple(items), self.elasticity is not None, len(self.pose))

    def frame_item(
        self, equations: Equations, item: FrameItem, vectors: FloatArray | None, *,
        multipliers: str = "", C: FloatArray | None = None, reads: str = "",
        generators: Sequence[Csr] = (),
    ) -> None:
        """Adds one item of the frame equations with its functionals of the displacements `vectors`
        (d N, directions).

        multipliers, C (l, forces): the constraint rows of that block are C @ the item's rows;
        reads: rigid block of the other body whose coordinates the item uses; generators: matrices
        of the elastic inertia.
        """
        e = self.elasticity
        equations.frame(
            self.name, item, None if e is None or vectors is None else vectors[e.free],
            multipliers=multipliers, C=C, reads=reads, generators=generators)

    # ------------------------------------------------------------------ loads and joints

    def space_force(
        self, equations: Equations, weights: FloatArray, force: FloatArray, amplitude: Amplitude
    ) -> None:
        """Adds nodal weights (N,) times one force (d,) (N per unit weight) in space axes."""
        item = SpaceForce(float(weights.sum()), weights @ self.X, force, amplitude)
        self.frame_item(equations, item, nodal.along(weights, self.d))

    def gravity(self, equations: Equations, g: FloatArray, amplitude: Amplitude) -> None:
        """Adds the weight of the deformed body: nodal masses times g (d,), m/s^2."""
        if self.inertia is None:
            return
        item = SpaceForce(self.inertia.mass, self.inertia.moment, g, amplitude)
        m = self.mass_matrix
        self.frame_item(equations, item, None if m is None else nodal.along(
            np.asarray(m.sum(axis=1)).ravel(), self.d))

    def body_force(self, equations: Equations, forces: FloatArray, amplitude: Amplitude) -> None:
        """Adds nodal forces (N, d), N, that rotate with the body frame."""
        item = BodyForce(forces.sum(axis=0), torque(self.X, forces).sum(axis=0), amplitude)
        self.frame_item(equations, item, nodal.with_torques(forces))

    def attachment(self, weights: FloatArray) -> tuple[Attachment, FloatArray]:
        """Attachment at the mean point of the weighted nodes, with its functionals (d N, d)."""
        return Attachment(weights @ self.X), nodal.along(weights, self.d)

    def heat_load(
        self, equations: Equations, vector: FloatArray, amplitude: Amplitude,
        film: Csr | None = None,
    ) -> None:
        """Adds a nodal heat vector (N,), W, times an amplitude, and a convection matrix `film` (N,
        N), W/K."""
        assert self.heat is not None
        write_film(self.name, equations, self.heat, vector, amplitude, film)

    def law(
        self, equations: Equations, law: PointwiseLaw, *, facets: IntArray | None = None,
        cells: IntArray | None = None,
    ) -> None:
        """Adds a pointwise law over boundary facets (F, d) of point numbers, or over cells given by
        their numbers, all of them if neither is given."""
        write_law(self, equations, equations.over_steps(law), facets, cells)

    def surface_loads(
        self, equations: Equations, loads: SurfaceLoads, times: FloatArray
    ) -> None:
        """Adds loads that move over its surface, at times (T,), s, as tables on each of its fields.
        """
        write_surface_loads(self, equations, loads, times)

    def geometry(self) -> Mapping[str, tuple[FloatArray, IntArray]]:
        """Elastic and thermal block name -> node coordinates (n, d), m, and component (n,) of each
        unknown."""
        points, found, d = self.X, {}, self.d
        if self.elasticity is not None:
            free = self.elasticity.free
            found[f"{self.name}.elastic"] = (points[free // d], free % d)
        if self.heat is not None:
            found[f"{self.name}.thermal"] = (points[self.heat.free], 0 * self.heat.free)
        return found

    def shape(self) -> BodyShape | None:
        """Geometry of the body for storage with the results; None for a body without a mesh."""
        if self.mesh is None:
            return None
        e, h = self.elasticity, self.heat
        return BodyShape(self.mesh.points, self.mesh.nodes, None if e is None else e.free,
                         None if h is None else h.free, pose=self.pose,
                         given=() if h is None else h.prescribed,
                         eliminated_temperature=self.T0 if h is None and e is not None else None,
                         stress=None if e is None or not e.recoverable or self.T_ref is None else (
                             e.stress_constants(len(self.mesh.cells), self.T_ref)))

    # ------------------------------------------------------------------ positions, sets and probes

    def start_rotation(self) -> FloatArray:
        """(d, d) initial rotation matrix from body axes to space axes."""
        return np.stack([vectors_in_space(self.pose[None], e)[0] for e in np.eye(self.d)], axis=1)

    def start_position(self, weights: FloatArray) -> FloatArray:
        """(d,) initial position of the weighted mean point, m (space axes)."""
        return np.asarray(points_in_space(self.pose[None], (weights @ self.X)[None])[0])

    def named(self, which: str, key: str) -> IntArray:
        """Points of a named set; InputError under `key` with the names of the existing sets."""
        if which not in self.points:
            raise InputError(f"body {self.name!r} has no set {which!r}: "
                             f"{suggestions(which, sorted(self.points), 'sets')}", key)
        return self.points[which]

    def centre_of(self, which: str, nodes: IntArray) -> Centre:
        """Centre of the set `which`, whose points are `nodes`."""
        if self.mesh is None:
            return Centre.of_points(self.X, nodes)
        return centre_of_set(self.mesh, nodes, self.centres.get(which), which)

    def probe(self, name: str, at: str | Sequence[float]) -> ProbePlace:
        """Probe at a material point: the centre of a named set, or the node nearest to body
        coordinates (d,), m."""
        weights, point = self._probed(at)
        displacement: FloatArray | None = None
        temperature: FloatArray | None = None
        prescribed: tuple[tuple[float, TimeFunction], ...] = ()
        if self.elasticity is not None:
            every = np.asarray(np.kron(weights[:, None], np.eye(len(point))))
            displacement = every[self.elasticity.free]
        if self.heat is not None:
            temperature = weights[self.heat.free]
            prescribed = tuple((float(weights[n].sum()), f) for n, f in self.heat.prescribed)
        return ProbePlace(name, self.name, point, displacement, temperature, prescribed,
                          self.pose, self.guide)

    def _probed(self, at: str | Sequence[float]) -> tuple[FloatArray, FloatArray]:
        """Weights (N,) and reference position (d,), m (body frame), of a probe."""
        points, weights = self.X, np.zeros(len(self.X))
        if isinstance(at, str):
            centre = self.centre_of(at, self.named(at, "at"))
            return centre.weights, centre.point
        elif len(at) != self.d:
            raise InputError(f"body {self.name!r} is {KINDS[self.d]} coordinates", "at")
        elif self.mesh is None:  # a rigid body is the same everywhere
            return weights, np.array(at, dtype=np.float64)
        else:
            weights[np.argmin(np.linalg.norm(points - np.array(at), axis=1))] = 1.0
        return weights, weights @ points
