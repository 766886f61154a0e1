"""Body of a scene, in the plane or in space: unknowns, fields, equations, and the interface for
joints, loads and contacts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np

from sparsemor.bodies.fem.element_balance import elastic_integrals, heat_integrals
from sparsemor.bodies.fem.field_matrices import Elasticity, Heat
from sparsemor.bodies.fem.pointwise_law import PointwiseLaw
from sparsemor.bodies.fem.shear_locking import bending_notes
from sparsemor.bodies.fem.stress import CellStress
from sparsemor.bodies.frames.applied_forces import BodyForce, SpaceForce
from sparsemor.bodies.frames.floating import (
    FieldInertia,
    inertia_matrices,
    write_frame,
    write_weight,
)
from sparsemor.bodies.frames.frame_items import Stiffening
from sparsemor.bodies.frames.mass_moments import MassProperties
from sparsemor.bodies.frames.mean_displacement_and_rotation import (
    mean_displacement,
    mean_rotation,
    with_torques,
)
from sparsemor.bodies.frames.rotation import torque
from sparsemor.bodies.mesh.point_sets import PointSet
from sparsemor.bodies.mesh.set_centres import Centre, centre_of_set
from sparsemor.bodies.terms.body_terms import (
    about,
    generator,
    write_conduction,
    write_elasticity,
    write_film,
    write_law,
    write_surface_loads,
)
from sparsemor.bodies.terms.field_kinds import ELASTIC, MULTIPLIER, RIGID, THERMAL
from sparsemor.bodies.terms.geometric_stiffness import load_stiffness, stress_stiffness
from sparsemor.core import (
    Amplitude,
    Block,
    Body,
    BodyShape,
    Csr,
    Equations,
    FloatArray,
    FrameHistory,
    InputError,
    IntArray,
    Layout,
    Mesh,
    Note,
    ProbePlace,
    SurfaceLoads,
    TimeFunction,
    suggestions,
)
from sparsemor.core.protocols.body import MeanTemperature, ProbeStress
from sparsemor.core.protocols.body_frame import FrameItem
from sparsemor.core.protocols.separable import StressStiffness

NO_NUMBERS = np.zeros(0, np.int64)
KINDS = {2: "plane: give two", 3: "spatial: give three"}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FloatingBody(Body):
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
    fields. folder: where paths of files in a scene start.
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
    folder: Path = Path()
    _found: dict[str, tuple[Note, ...]] = field(init=False, default_factory=dict)
    _centres: dict[str, Centre] = field(init=False, default_factory=dict)
    _stiffness: dict[bytes, Csr] = field(init=False, default_factory=dict)

    @property
    def d(self) -> int:
        """Dimension: 2 or 3."""
        return int(self.X.shape[1])

    @property
    def revolved(self) -> bool:
        """True for a body of revolution, of which the mesh is the section."""
        return self.mesh is not None and self.mesh.revolved

    @property
    def total_mass(self) -> float | None:
        return None if self.inertia is None else self.inertia.mass

    @property
    def set_sizes(self) -> Mapping[str, int]:
        return {name: len(nodes) for name, nodes in self.points.items()}

    @property
    def notes(self) -> tuple[Note, ...]:
        """Warnings about its mesh, sets and bending stiffness."""
        if "bending" not in self._found:
            e, mesh = self.elasticity, self.mesh
            self._found["bending"] = () if e is None or mesh is None or mesh.revolved or any(
                law.anisotropy is not None for _, law in e.regions) else tuple(
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
            given = tuple((n, equations.stepping.prescribed(f), w)
                          for n, f, w in self.heat.prescribed)
            replace(self, heat=replace(self.heat, prescribed=given))._contribute(equations)
        else:
            self._contribute(equations)

    def _contribute(self, equations: Equations) -> None:
        """Adds the equations of the frame and of the fields. Functions for reducers and checks,
        which are called if they are needed: integrals per element; stress_stiffness: stiffness by
        the stress, with flags whether the equations have it; stiffened: that by the loads of a body
        with prestressed strains."""
        mesh = self.mesh is not None
        write_frame(
            equations, self, self.inertia, self._field_inertia(),
            elastic_integrals=partial(elastic_integrals, self) if mesh else None,
            heat_integrals=partial(heat_integrals, self) if mesh else None,
            stress_stiffness=None if (
                self.elasticity is None or not mesh or self.revolved) else StressStiffness(
                partial(stress_stiffness, self),
                self.elasticity.nonlinear or self.elasticity.prestressed,
                self.elasticity.prestressed),
            stiffened=self._stiffened if (
                self.elasticity is not None and self.elasticity.prestressed) else None)
        if self.elasticity is not None:
            write_elasticity(self, equations, self.elasticity)
        if self.heat is not None:
            write_conduction(self, equations, self.heat)

    def _stiffened(
        self, directions: FloatArray, first: int
    ) -> tuple[FrameItem, tuple[Csr, ...]]:
        """Geometric stiffness of a body whose strains are `prestressed`."""
        assert self.elasticity is not None
        matrices = load_stiffness(self, directions, self._stiffness)
        return Stiffening(first, len(matrices)), matrices

    def _field_inertia(self) -> FieldInertia | None:
        """Inertia of the free displacements; None without them, or without mass."""
        if self.elasticity is None or self.mass_matrix is None or self.inertia is None:
            return None
        m, F, B = self.mass_matrix, self.elasticity.free, inertia_matrices(self.pose)
        return FieldInertia(mean_displacement(self._nodal_masses(), self.d)[F],
                            about(m, self.X, B)[F], [generator(m, b)[F][:, F] for b in B])

    def _first(self) -> FloatArray | None:
        """(n, d) mass of the free displacements along each axis, kg."""
        return None if self.mass_matrix is None else self._functionals(
            mean_displacement(self._nodal_masses(), self.d))

    def _nodal_masses(self) -> FloatArray:
        assert self.mass_matrix is not None
        return np.asarray(self.mass_matrix.sum(axis=1)).ravel()

    def _functionals(self, vectors: FloatArray) -> FloatArray | None:
        """Rows of the free displacements, of functionals (d N, p) of all of them."""
        return None if self.elasticity is None else vectors[self.elasticity.free]

    # ------------------------------------------------------------------ loads and joints

    def space_force(
        self, equations: Equations, weights: FloatArray, force: FloatArray, amplitude: Amplitude
    ) -> None:
        """Adds nodal weights (N,) times one force (d,) (N per unit weight) in space axes."""
        item = SpaceForce(float(weights.sum()), weights @ self.X, force, amplitude)
        equations.frame(self.name, item, self._functionals(mean_displacement(weights, self.d)))

    def gravity(self, equations: Equations, g: FloatArray, amplitude: Amplitude) -> None:
        """Adds the weight of the deformed body: nodal masses times g (d,), m/s^2."""
        if self.inertia is None:
            return
        if self.revolved and g[0] != 0.0:
            raise InputError(f"{self.name!r} is axisymmetric: its weight acts along its axis y "
                             f"alone (got {g[0]:g} m/s2 across it)", "g")
        write_weight(equations, self, self.inertia, g, amplitude, self._first())

    def body_force(self, equations: Equations, forces: FloatArray, amplitude: Amplitude) -> None:
        """Adds nodal forces (N, d), N, that rotate with the body frame."""
        item = BodyForce(forces.sum(axis=0), torque(self.X, forces).sum(axis=0), amplitude)
        equations.frame(self.name, item, self._functionals(with_torques(forces)))

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

    def surface_loads(self, equations: Equations, loads: SurfaceLoads, times: FloatArray) -> bool:
        """Adds loads that move over its surface, at times (T,), s, as tables on each of its fields.
        """
        if self.elasticity is not None and self.elasticity.prestressed:
            raise InputError(f"loads that move over {self.name!r} do not stiffen a body whose "
                             "strains are prestressed: take strains: nonlinear there")
        write_surface_loads(self, equations, loads, times)
        return True

    def geometry(self) -> Mapping[str, tuple[FloatArray, IntArray]]:
        """Elastic and thermal block name -> node coordinates (n, d), m, and component (n,) of each
        unknown."""
        found = {}
        if self.elasticity is not None:
            found[f"{self.name}.elastic"] = self._places(self.elasticity.free)
        if self.heat is not None:
            found[f"{self.name}.thermal"] = (self.X[self.heat.free], 0 * self.heat.free)
        return found

    def _places(self, free: IntArray) -> tuple[FloatArray, IntArray]:
        """Node coordinates (n, d), m, and components (n,) of free displacements."""
        return self.X[free // self.d], free % self.d

    def shape(self) -> BodyShape | None:
        """Geometry of the body for storage with the results; None for a body without a mesh."""
        if self.mesh is None:
            return None
        e, h = self.elasticity, self.heat
        return BodyShape(self.mesh.points, self.mesh.nodes, None if e is None else e.free,
                         None if h is None or not len(h.free) else h.free, pose=self.pose,
                         given=() if h is None else h.prescribed,
                         eliminated_temperature=self.T0 if h is None and e is not None else None,
                         stress=None if e is None or not e.recoverable or self.T_ref is None else (
                             e.stress_constants(self.mesh, self.T_ref)))

    # ------------------------------------------------------------------ positions, sets and probes

    @property
    def extent(self) -> float:
        return float(np.ptp(self.X, axis=0).max()) if len(self.X) else 0.0

    def point_of(self, which: str, key: str) -> FloatArray:
        if self.revolved:
            raise InputError(f"{self.name!r} is axisymmetric: a point of its section is a ring, on "
                             "which no joint or force at a point acts; take loads on surfaces", key)
        return np.asarray(self.centre_of(which, self.named(which, key)).weights @ self.X)

    def point_in_words(self, which: str) -> str:
        if self.mesh is None:
            return ""
        centre = self.centre_of(which, self.points[which])
        return f"{centre.how}, is {centre.shift:.3g} m from the mean of its facets" if (
            centre.shift > 1e-9 * self.extent) else ""

    def displacement_of(self, which: str) -> FloatArray | None:
        return self._functionals(mean_displacement(
            self.centre_of(which, self.points[which]).weights, self.d))

    def rotation_of(self, which: str, key: str) -> FloatArray | None:
        """Mean rotation of the set, by least squares, as functionals (n, r) of its n free
        displacements, r = 1 in the plane, 3 in space; None for a rigid body or a set of fixed
        points. InputError under `key` where it is undefined."""
        if self.elasticity is None:
            return None
        nodes = self.points[which]
        if len(nodes) < 2 and self.d == 2:
            raise InputError(f"'{self.name}:{which}' is a single point of a flexible body and has "
                             "no angle: attach to a set of two or more points", key)
        try:
            # even: weights (N,) of the mean over the facets of the set, also if its centre is given
            turns = mean_rotation(self.centre_of(which, nodes).even, self.X)
        except np.linalg.LinAlgError:
            where, what = ("are at one place", "two or more places") if self.d == 2 else (
                "lie on one line (or are one point)", "a set that spans a plane")
            raise InputError(
                f"the points of '{self.name}:{which}' {where}, so their mean rotation is "
                f"undefined: attach to {what}", key) from None
        found = self._functionals(turns[:, : 2 * self.d - 3])
        return found if found is not None and found.any() else None

    def deforms_at(self, which: str) -> bool:
        e = self.elasticity
        return e is not None and bool(np.isin(self.points[which], e.free // self.d).any())

    def temperature_of(self, which: str) -> MeanTemperature | None:
        """Mean over the facets of the set."""
        if self.heat is None:
            return None
        weights = self.centre_of(which, self.points[which]).even
        return MeanTemperature(weights[self.heat.free], tuple(
            (float(weights[nodes] @ w), f) for nodes, f, w in self.heat.prescribed))

    def named(self, which: str, key: str) -> IntArray:
        """Points of a named set; InputError under `key` with the names of the existing sets."""
        if which not in self.points:
            raise InputError(f"body {self.name!r} has no set {which!r}: "
                             f"{suggestions(which, sorted(self.points), 'sets')}", key)
        return self.points[which]

    def centre_of(self, which: str, nodes: IntArray) -> Centre:
        """Centre of the set `which`, whose points are `nodes`."""
        if which not in self._centres:
            self._centres[which] = Centre.of_points(self.X, nodes) if self.mesh is None else (
                centre_of_set(self.mesh, nodes, self.centres.get(which), which))
        return self._centres[which]

    def probe(self, name: str, at: str | Sequence[float]) -> ProbePlace:
        """Probe at a material point: the centre of a named set, or the node nearest to body
        coordinates (d,), m. Displacement and temperature are weighted sums of nodal ones, of which
        prescribed temperatures are pairs of a factor and a function of time."""
        weights, point = self._probed(at)
        temperature: FloatArray | None = None
        prescribed: tuple[tuple[float, TimeFunction], ...] = ()
        displacement = self._functionals(mean_displacement(weights, self.d))
        if self.heat is not None:
            temperature = weights[self.heat.free]
            prescribed = tuple((float(weights[n] @ w), f) for n, f, w in self.heat.prescribed)
        return ProbePlace(name, self.name, point, displacement, temperature, prescribed,
                          self.pose, self.guide)

    def stress_at(self, at: str | Sequence[float]) -> ProbeStress | None:
        """Stress at a point as a linear functional of displacements and temperatures; None where
        the law of the stress is not linear with constant isotropic properties. by_u (d N, 6), by_T
        (N, 6): derivatives by all nodal values; the constant part is that of T - T_ref without the
        unknown T, and prescribed ones are pairs of a stress and a function of time."""
        e, h, mesh = self.elasticity, self.heat, self.mesh
        if e is None or mesh is None or e.nonlinear or not e.recoverable or mesh.revolved:
            return None
        assert self.T0 is not None and self.T_ref is not None
        s = e.stress_constants(mesh, self.T_ref)
        stress = CellStress(mesh.points, mesh.nodes, s.constants, s.region)
        if stress.general:
            return None
        by_u, by_T = stress.functional(self._probed(at)[0])
        if h is None:
            return ProbeStress(by_u[e.free], None, (self.T0 - self.T_ref) @ by_T)
        return ProbeStress(by_u[e.free], by_T[h.free], -self.T_ref @ by_T,
                           tuple((w @ by_T[nodes], f) for nodes, f, w in h.prescribed))

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
