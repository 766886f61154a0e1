"""Flexible body in a floating frame of reference: finite elements of first or second order, elastic
and thermal fields.

The mesh determines the dimension: triangles and quadrilaterals make a planar body, tetrahedra,
wedges and hexahedra a body in space.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator
from scipy.sparse import csr_array

from sparsemor.bodies.axisymmetric import held, option_faults, revolved_faults
from sparsemor.bodies.fem.elasticity import Model, elastic_stiffness, law, thermoelastic_coupling
from sparsemor.bodies.fem.field_matrices import Elasticity, Heat, ModalFactors
from sparsemor.bodies.fem.integrals import capacity, conductivity, lumped, scalar_mass
from sparsemor.bodies.fem.quadratic_cells import with_midpoints, without_midpoints
from sparsemor.bodies.fem.stress import CellStress
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.frames.mass_moments import MassProperties
from sparsemor.bodies.initial_pose import Pose
from sparsemor.bodies.material import Region, constants_at, curves, regions_of, require, summed
from sparsemor.bodies.mesh.coordinate_expressions import FormulaText, evaluate_formula
from sparsemor.bodies.mesh.mesh_checks_and_repairs import check_mesh, mesh_notes
from sparsemor.bodies.mesh.point_sets import PointSet, given_centres, with_sets
from sparsemor.bodies.reference_conditions import Reference
from sparsemor.bodies.temperature_file import TemperatureFile
from sparsemor.bodies.terms.body_terms import generator
from sparsemor.bodies.terms.field_kinds import BODY_KINDS, ELASTIC, THERMAL
from sparsemor.bodies.terms.material_laws import heat_laws, stress_laws
from sparsemor.bodies.terms.modal_damping import modal_factors
from sparsemor.core import (
    BodyPlugin,
    Csr,
    Fault,
    FieldKind,
    FloatArray,
    Gather,
    InputError,
    IntArray,
    Material,
    Mesh,
    MeshPlugin,
    MeshSize,
    Plugin,
    Slot,
    slot_default,
)
from sparsemor.core.protocols.mesh import BodySize
from sparsemor.core.registry.returned_values import checked_return


def _isotropic(materials: Any) -> Any:
    """Materials by set, those without `use` as isotropic ones."""
    if not isinstance(materials, Mapping):
        return materials
    return {name: {"use": "isotropic", **m} if isinstance(m, Mapping) else m
            for name, m in materials.items()}


MODES = 20
"""Number of modes with modal damping, when it is not given."""


class Damping(Plugin):
    """Damping of the displacement rates in the body frame: Rayleigh damping, mass * M + stiffness
    * K, and modal damping, 2 ratio omega of the lowest elastic modes with angular frequency omega.

    Rigid motion is not damped, so a body that is split into two has slightly different damping.
    """

    mass: float = Field(default=0.0, ge=0)
    """Factor of the mass matrix, 1/s."""
    stiffness: float = Field(default=0.0, ge=0)
    """Factor of the stiffness matrix, s."""
    ratio: Annotated[float, Field(ge=0)] | Annotated[
        list[Annotated[float, Field(ge=0)]], Field(min_length=1)] | None = None
    """Damping ratio (1: critical) of the lowest elastic modes: one number for `modes` of them, or a
    list, one each. Higher modes have Rayleigh damping only."""
    modes: int = Field(default=MODES, ge=1)
    """Number of modes that one `ratio` damps; all elastic modes when there are fewer."""
    modes_of: Literal["free", "held"] | None = None
    """The modes are those of the body alone in space (`free`), or `held` by its reference
    conditions, as where a joint holds a clamped set. When not given: `free` for a floating frame,
    `held` otherwise."""

    @model_validator(mode="after")
    def _of_a_ratio(self) -> Self:
        if self.ratio is None and self.modes_of is not None:
            raise ValueError("modes_of says nothing without a ratio: give one, or drop it")
        if self.modes != MODES and (self.ratio is None or isinstance(self.ratio, list)):
            raise ValueError("modes is the number of modes that have one ratio, a single number: a "
                             "list has as many modes as ratios")
        return self

    def of(
        self, K: Csr, M: Csr, fixed: IntArray, d: int, floating: bool
    ) -> tuple[Csr, ModalFactors | None]:
        """Rayleigh damping matrix, and factors of modal damping, of a body in d dimensions with
        stiffness K and mass M (n, n), of which its reference conditions fix the unknowns `fixed`.
        InputError under `damping`. The modes are those of the free body, after its rigid ones, or
        those with the fixed unknowns at zero (held); floating: of the body's frame."""
        held = self.modes_of == "held" or (self.modes_of is None and not floating)
        gather = Gather()
        modal = None if self.ratio is None else gather(
            "damping", modal_factors, K, M, fixed if held else fixed[:0],
            0 if held else d * (d + 1) // 2, self.ratio, self.modes)
        gather.check()
        return csr_array(self.mass * M + self.stiffness * K), modal


def body_size(mesh: MeshSize, elastic: bool, thermal: bool) -> BodySize:
    """Numbers of unknowns and of matrix entries of a body with the given fields: stiffness and
    thermal forces; mass, capacity and conduction."""
    d = mesh.dimension
    unknowns = ({ELASTIC.name: d * mesh.points} if elastic else {}) | (
        {THERMAL.name: mesh.points} if thermal else {})
    return BodySize(mesh, unknowns, mesh.pairs * (d * d + d * thermal) if elastic else 0,
                    mesh.pairs * (1 + 2 * thermal))


class Flexible(BodyPlugin):
    """Flexible body in a floating frame of reference, with displacement and temperature fields."""

    field_kinds: ClassVar[tuple[FieldKind, ...]] = BODY_KINDS

    mesh: Annotated[MeshPlugin, Slot("mesh")]
    """Mesh plugin."""
    sets: dict[str, PointSet] = {}
    """Additional named point sets."""
    order: Literal[1, 2] | None = None
    """Polynomial degree of displacements and temperatures in each element. 2: further nodes on its
    edges, and inside quadrilaterals and hexahedra; sets, which are found among the corners, contain
    those between their corners. 1: by the corners, with straight edges. Not given: 2 for an elastic
    body with the mesh of a file or geometry, because cells of first order are too stiff in bending;
    otherwise that of the mesh, 1 of a generated one (`rectangle`, `block`, ...)."""
    thickness: float | None = Field(default=None, gt=0)
    """Thickness of a planar body, m."""
    material: Annotated[Material, Slot("material")] = slot_default("isotropic")
    """Material, by its properties or by a plugin that provides them."""
    materials: Annotated[
        dict[str, Annotated[Material, Slot("material")]], BeforeValidator(_isotropic)] = {}
    """Other materials by set: of the cells that a mesh file tags with its name, otherwise of the
    cells with all points in the set."""
    model: Literal["plane_stress", "plane_strain", "solid"] | None = None
    """Elastic model: plane stress in the plane when not given, `solid` in space."""
    axisymmetric: bool = False
    """The plane mesh is the section of a body of revolution, x the distance from its axis y: its
    frame is `fixed`, it has no thickness, its strains are linear."""
    strains: Literal["linear", "prestressed", "nonlinear"] = "linear"
    """Strains of the elastic field, in the body frame. `linear`: small strains and rotations;
    a body then does not become stiffer or softer by its stress, as when it spins or is pushed.
    `prestressed`: the same, with the geometric stiffness of its present loads: inertia, joint
    forces, forces and constant temperatures; not of a thermal field.
    `nonlinear`: Green-Lagrange strains (St. Venant-Kirchhoff material), for large rotations within
    the body and for buckling; strains themselves remain small."""
    fields: list[Literal["elastic", "thermal"]]
    """Fields of the body; `[]`: none, a rigid body with the mass and shape of its mesh."""
    coupling: Literal["one_way", "two_way"] = "one_way"
    """Thermoelastic coupling. `one_way`: temperatures strain the body. `two_way`: strain rates also
    heat it, with -T_ref beta : strain rate (W/m^3), as in thermoelastic damping; T_ref is the
    reference temperature, and c then the specific heat at constant strain."""
    reference: Reference | None = None
    """Reference conditions of the elastic field."""
    damping: Damping = Damping()
    """Rayleigh and modal damping of the elastic field."""
    frame: Literal["floating", "fixed", "spinning"] = "floating"
    """Motion of the body frame. `fixed`: it stays at its pose and has no unknowns. `spinning`: in
    space, it rotates about the z axis alone, by an angle."""
    pose: Pose = Pose()
    """Initial position and rotation of the frame, and their rates."""
    capacity: Literal["consistent", "lumped"] = "consistent"
    """Heat capacity matrix. `lumped`: row sums on the diagonal, which avoids temperature
    undershoots under fast heating if no angle of the mesh is obtuse."""
    reference_temperature: float = 293.15
    """Stress-free temperature, K. Matrices of a body are constant, with the properties at this
    temperature; properties that depend on temperature add pointwise laws for the difference."""
    initial_temperature: float | FormulaText | TemperatureFile | None = None
    """Initial temperature, K, a number, a formula in x, y (and z), or temperatures of a file at its
    first time; the reference temperature when not given."""

    @property
    def immobile(self) -> bool:
        """True if the body has heat alone: its frame is fixed, and it has no displacements."""
        return self.frame == "fixed" and ELASTIC.name not in self.fields

    @property
    def selected_fields(self) -> Sequence[str]:
        """Names of the fields of the body."""
        return self.fields

    @property
    def stored_classes(self) -> Sequence[object]:
        """Classes of the frames and terms of a kept model."""
        from sparsemor.bodies.stored_classes import CLASSES

        return CLASSES

    def expected(self) -> BodySize | None:
        """Estimated size of the body before it is meshed; None where the mesh plugin cannot
        estimate it."""
        mesh = self.mesh.expected()
        second = self.order == 2 and bool(self.fields)
        return None if mesh is None else body_size(mesh.quadratic() if second else mesh,
                         ELASTIC.name in self.fields, THERMAL.name in self.fields)

    @classmethod
    def stress_recovery(
        cls, points: FloatArray, cells: IntArray, constants: FloatArray, region: IntArray,
        nonlinear: bool,
    ) -> CellStress:
        """Strain and stress of a body from its stored displacements and temperatures."""
        return CellStress(points, cells, constants, region, nonlinear)

    def build(self, name: str, base: Path) -> FloatingBody:
        """The body with its mesh, sets, fields and initial state; faults of all options are
        reported together: gather(key, function, ..) collects those of a call and then returns None.

        fixed: numbers of the displacements of the reference condition, None without an elastic
        field; regions: cells of each material; m (N, N): scalar mass matrix, kg.
        """
        gather = Gather()
        self._check_options(gather)
        mesh = gather("", self._mesh, base)
        gather.check()
        assert mesh is not None
        self._check_dimension(mesh, gather)
        gather.check()
        fixed = gather("", self._fixed, mesh)
        T0 = gather("", self._initial_temperature, mesh, base)
        regions = gather("materials", regions_of, mesh, self.material, self.materials,
                         self.reference_temperature)
        centres = gather("sets", given_centres, mesh, self.sets)
        gather.check()
        assert T0 is not None and regions is not None and centres is not None
        d, thickness, heats = mesh.dimension, self._thickness(mesh), THERMAL.name in self.fields
        m = summed(regions, lambda r: scalar_mass(mesh, r.constants.rho * thickness, r.cells))
        pose, velocity = self.pose.start(d, self.frame == "spinning")
        return FloatingBody(
            name=name, folder=base, X=mesh.points,
            inertia=MassProperties.of_mesh(m, mesh.points), pose=pose,
            velocity=velocity, moves=self.frame != "fixed", points=mesh.point_sets,
            centres=centres, declared=self.sets, mesh=mesh, thickness=thickness, mass_matrix=m,
            elasticity=None if fixed is None else self._elasticity(mesh, m, fixed, regions, T0),
            heat=self._heat(mesh, regions) if heats else None, T0=T0,
            temperature_limits=self._limits(),
            T_ref=np.full(len(mesh.points), self.reference_temperature),
            mesh_notes=(*mesh.notes, *mesh_notes(name, mesh, self.sets, regions[0].constants.rho)))

    def _mesh(self, base: Path) -> Mesh:
        """Mesh with the sets of the options, of the order that they or the fields ask for. Raises
        InputError located at `mesh` or `sets`."""
        try:
            mesh = checked_return(self.mesh.build(base), Mesh, self.mesh, "build")
        except InputError as error:
            raise error.under("mesh") from None
        check_mesh(mesh)  # its faults have the key "mesh"
        try:
            mesh = with_sets(mesh, self.sets)
        except InputError as error:
            raise error.under("sets") from None
        order = self.order
        if not self.fields:  # no field to interpolate
            order = mesh.order
        elif order is None:
            given = self.mesh.expected() is None  # by a file, not by divisions
            order = 2 if ELASTIC.name in self.fields and given else mesh.order
        if order != mesh.order:
            mesh = with_midpoints(mesh) if order == 2 else without_midpoints(mesh)
        return replace(mesh, revolved=True) if self.axisymmetric else mesh

    def _check_options(self, gather: Gather) -> None:
        """Adds the faults of options that need no mesh to `gather`: a missing reference condition,
        combinations of strains, coupling and materials, and missing properties."""
        if "elastic" in self.fields:
            if self.reference is None:
                gather.faults.append(Fault(
                    "reference", "missing: the elastic field needs a reference condition, such as "
                    "{clamp: left} or {chord: [a, b]}, or its displacements hold rigid motion"))
        if self.coupling == "two_way":
            gather("coupling", self._check_two_way)
        if self.strains != "linear" or self.axisymmetric:
            gather.faults += [Fault(key, "properties that depend on the direction suit linear "
                                    "strains of bodies that are not axisymmetric")
                              for key, m in self._materials().items()
                              if m.directional() is not None]
        changing = [key for key, m in self._materials().items()
                    if not curves(m).keys().isdisjoint({"E", "alpha"})]
        if self.strains == "prestressed" and (THERMAL.name in self.fields or changing):
            gather.faults.append(Fault(
                "strains", "prestressed: the loads of the moment stiffen the body by constant "
                "matrices, which a thermal field, E(T) and alpha(T) do not have: take nonlinear"))
        needed = {"elastic": ("E", "nu"), "thermal": ("k", "c")}
        for key, material in self._materials().items():
            for field in ("elastic", "thermal"):
                if field in self.fields:
                    gather(key, require, constants_at(material, self.reference_temperature),
                           needed[field], field)

    def _check_two_way(self) -> None:
        """InputError where the heat of deformation is not linear, or has nothing to act on."""
        if not {"elastic", "thermal"} <= set(self.fields):
            raise InputError("two_way acts between two fields: add both, elastic and thermal")
        if self.strains == "nonlinear":
            raise InputError("the heat of deformation is that of linear strains: take strains: "
                             "linear, or coupling: one_way")
        for key, material in self._materials().items():
            varies = sorted(curves(material).keys() & {"E", "alpha"})
            if varies:
                raise InputError(f"the heat of deformation is that of constant E and alpha, and "
                                 f"{key}.{varies[0]} depends on temperature: take one_way")

    def _materials(self) -> dict[str, Material]:
        """Materials by their input keys."""
        return {"material": self.material,
                **{f"materials.{name}": m for name, m in self.materials.items()}}

    def _limits(self) -> dict[str, tuple[float, float]]:
        """Temperatures, K, between which each property in use is defined, by input key."""
        used = {"E", "alpha"} if "elastic" in self.fields else set[str]()
        used |= {"k", "c"} if "thermal" in self.fields else set()
        return {f"{key}.{name}": curve.limits for key, material in self._materials().items()
                for name, curve in curves(material).items() if name in used}

    def _check_dimension(self, mesh: Mesh, gather: Gather) -> None:
        """Adds the faults of options that depend on the dimension and order of the mesh to
        `gather`: capacity, thickness, model, frame and pose."""
        plane = mesh.dimension == 2
        if mesh.order == 2 and THERMAL.name in self.fields and self.capacity == "lumped":
            gather.faults.append(Fault(
                "capacity", "row sums of quadratic elements vanish or are negative at their "
                "corners: take consistent, or order: 1"))
        if self.axisymmetric:
            gather.faults += option_faults(
                plane, self._materials(), frame=self.frame, thickness=self.thickness,
                model=self.model, strains=self.strains, coupling=self.coupling,
                capacity=self.capacity)
            gather.faults += revolved_faults(mesh.points) if plane else ()
        elif plane and self.thickness is None:
            gather.faults.append(Fault("thickness", "missing: the mesh is plane (m)"))
        if not plane and self.thickness is not None:
            gather.faults.append(Fault("thickness", "the mesh is 3-D and has its own: drop it"))
        if self.model is not None and (self.model == "solid") is plane:
            allowed = "plane_stress or plane_strain" if plane else "solid"
            gather.faults.append(Fault(
                "model", f"{self.model} does not suit a {mesh.dimension}-D mesh: take {allowed}"))
        if plane and self.frame == "spinning":
            gather.faults.append(Fault("frame", "the mesh is plane: its frame is `floating`"))
        gather("", self.pose.start, mesh.dimension, self.frame == "spinning")

    def _thickness(self, mesh: Mesh) -> float:
        """Thickness, m, of a planar body; 1 in space."""
        return 1.0 if self.thickness is None else self.thickness

    def _model(self, mesh: Mesh) -> Model:
        if self.axisymmetric:  # the constants of a solid, with the hoop strain across the section
            return "plane_strain"
        return self.model or ("plane_stress" if mesh.dimension == 2 else "solid")

    def _fixed(self, mesh: Mesh) -> IntArray | None:
        """Numbers d node + component of the displacements that the reference condition fixes at
        zero, of a body of revolution also across the axis (`held`); None without an elastic
        field."""
        if "elastic" not in self.fields or self.reference is None:
            return None
        fixed = self.reference.fixed(mesh)
        if self.axisymmetric:
            fixed = held(mesh, fixed)
        if len(fixed) == mesh.points.size:
            raise InputError(f"fixes all {len(fixed)} displacements of the {len(mesh.points)} "
                             "points, so that none is left to solve for: fix fewer points, "
                             "refine the mesh, or leave `elastic` out of fields", "reference")
        return fixed

    def _elasticity(
        self, mesh: Mesh, m: Any, fixed: IntArray, regions: Sequence[Region], T0: FloatArray
    ) -> Elasticity:
        """Matrices of the elastic field and, for properties that depend on temperature and for
        nonlinear strains, their laws. m (N, N): scalar mass matrix, kg; fixed: numbers d node +
        component of displacements; regions: cells of each material; T0 (N,): initial temperature,
        K, by which a body without a thermal field may be heated too; K, M (d N, d N)."""
        heated = THERMAL.name in self.fields or bool((T0 != self.reference_temperature).any())
        nonlinear = self.strains == "nonlinear"
        d, thickness, model = mesh.dimension, self._thickness(mesh), self._model(mesh)
        K = summed(regions, lambda r: elastic_stiffness(
            mesh, r.constants, thickness, model, r.cells))
        M = generator(m, np.eye(d))
        damping, modal = self.damping.of(K, M, fixed, d, self.frame == "floating")
        return Elasticity(
            free=np.setdiff1d(np.arange(d * len(mesh.points)), fixed), stiffness=K,
            damping=damping, modal=modal,
            coupling=summed(regions, lambda r: thermoelastic_coupling(
                mesh, r.constants, thickness, model, r.cells)),
            regions=tuple((r.cells, law(r.constants, model)) for r in regions),
            laws=tuple((one, r.cells) for r in regions for one in stress_laws(
                r, model, d, self.reference_temperature, nonlinear, heated)),
            nonlinear=nonlinear, prestressed=self.strains == "prestressed",
            two_way=self.coupling == "two_way", recoverable=all(
                curves(r.material).keys().isdisjoint({"E", "alpha"}) for r in regions))

    def _heat(self, mesh: Mesh, regions: Sequence[Region]) -> Heat:
        """Matrices of the thermal field, and laws for properties that depend on temperature; those
        of a region by conductivity and specific heat (`_thermal`) at the reference temperature."""
        thickness, is_lumped = self._thickness(mesh), self.capacity == "lumped"
        d = mesh.dimension
        C = summed(regions, lambda r: capacity(
            mesh, r.constants.rho, _thermal(r)[1], thickness, r.cells))
        return Heat(
            free=np.arange(len(mesh.points)), capacity=lumped(C) if is_lumped else C,
            conductivity=summed(regions, lambda r: conductivity(
                mesh, _thermal(r, d)[0], thickness, r.cells)),
            regions=tuple((r.cells, (r.constants.rho * _thermal(r)[1] * thickness,
                                     _thermal(r, d)[0] * thickness)) for r in regions),
            lumped=is_lumped,
            laws=tuple((one, r.cells) for r in regions for one in heat_laws(r, mesh.dimension)))

    def _initial_temperature(self, mesh: Mesh, base: Path) -> FloatArray:
        """Nodal temperatures (N,) at the start, K: a number, a formula of the coordinates, or a
        file."""
        T0 = self.initial_temperature
        n = len(mesh.points)
        if T0 is None:
            return np.full(n, self.reference_temperature)
        if isinstance(T0, str):
            return evaluate_formula(T0, mesh.points, "initial_temperature")
        if isinstance(T0, TemperatureFile):
            size = float(np.ptp(mesh.points, axis=0).max())
            try:
                return np.asarray(T0.at(base, mesh.points, size).values[0])
            except InputError as error:
                raise error.under("initial_temperature") from None
        return np.full(n, float(T0))


def _thermal(region: Region, d: int = 3) -> tuple[float | FloatArray, float]:
    """Conductivity, W/(m K), a number or a tensor (d, d), and specific heat, J/(kg K), at the
    reference temperature."""
    found, own = require(region.constants, ("k", "c"), "thermal"), region.constants.directional()
    tensor = None if own is None else own.conductivity
    return found[0] if tensor is None else tensor[:d, :d], found[-1]
