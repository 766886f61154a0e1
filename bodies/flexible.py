"""A planar flexible body in a floating frame: linear triangles, elastic and thermal fields."""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator
from scipy.sparse import csr_array

from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.expression import FormulaText, evaluate_formula
from sparsemor.bodies.fe.elasticity import elastic_stiffness, law, thermoelastic_coupling
from sparsemor.bodies.fe.volume import capacity, conductivity, scalar_mass
from sparsemor.bodies.fields import Elasticity, Heat
from sparsemor.bodies.material import Material, require
from sparsemor.bodies.mesh.check import check_mesh
from sparsemor.bodies.mesh.sets import PointSet, find_set, with_sets
from sparsemor.bodies.pose import Pose
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import Fault, Gather, InputError
from sparsemor.core.mesh import Mesh
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import MeshPlugin
from sparsemor.core.slot import Slot


class Damping(Plugin):
    """Rayleigh damping, mass * M + stiffness * K, of the displacements' rates in the body frame:
    rigid motion is not damped, so a split body damps a little differently from a whole one."""

    mass: float = Field(default=0.0, ge=0)
    """Factor of the mass matrix, 1/s."""
    stiffness: float = Field(default=0.0, ge=0)
    """Factor of the stiffness matrix, s."""


class Reference(Plugin):
    """What ties the displacements to the frame, so that they hold no rigid motion."""

    chord: tuple[str, str] | None = None
    """Two one-point sets: u = 0 at the first, no motion across their line at the second."""
    clamp: str | None = None
    """A set whose points do not move in the body frame."""

    @model_validator(mode="after")
    def _one(self) -> "Reference":
        if (self.chord is None) == (self.clamp is None):
            raise InputError("a reference condition is either `chord` (two sets) or `clamp` (one)")
        return self

    def held(self, mesh: Mesh) -> IntArray:
        """Sorted numbers 2 node + component of the displacements that are zero."""
        if self.clamp is not None:
            nodes = find_set(mesh, self.clamp, "reference.clamp")
            if len(nodes) < 2:
                raise InputError(
                    f"set {self.clamp!r} is a single point: a clamp needs two or more, or the "
                    "body still turns about it", "reference.clamp")
            return np.sort(np.concatenate([2 * nodes, 2 * nodes + 1]))
        assert self.chord is not None
        ends = [find_set(mesh, s, "reference.chord") for s in self.chord]
        for name, nodes in zip(self.chord, ends, strict=True):
            if len(nodes) != 1:
                raise InputError(f"set {name!r} has {len(nodes)} points: a chord end is one point",
                                 "reference.chord")
        a, b = int(ends[0][0]), int(ends[1][0])
        if a == b:
            raise InputError("the two ends of the chord are the same point", "reference.chord")
        line = np.abs(mesh.points[b] - mesh.points[a])
        return np.sort(np.array([2 * a, 2 * a + 1, 2 * b + int(line[0] >= line[1])]))


class Flexible(Plugin):
    """Floating-frame body with linear triangles; a scene carries only the fields it names."""

    mesh: Annotated[MeshPlugin, Slot("mesh")]
    """Mesh plugin."""
    sets: dict[str, PointSet] = {}
    """More named point sets."""
    thickness: float = Field(gt=0)
    """Thickness, m."""
    material: Material
    """Constants of the material."""
    model: Literal["plane_stress", "plane_strain"] = "plane_stress"
    """Plane elasticity."""
    fields: list[Literal["elastic", "thermal"]]
    """Which fields the body has; `[]`: none, a rigid body with the mass and shape of its mesh."""
    reference: Reference | None = None
    """Reference conditions of the elastic field."""
    damping: Damping = Damping()
    """Rayleigh damping of the elastic field."""
    frame: Literal["floating", "fixed"] = "floating"
    """`fixed`: the frame stays at its pose and costs no unknowns."""
    pose: Pose = Pose()
    """Frame origin, angle and their rates at the start."""
    reference_temperature: float = 293.15
    """Stress-free temperature, K."""
    initial_temperature: float | FormulaText | None = None
    """K, a number or a formula in x and y; the reference temperature when not given."""

    def build(self, name: str, base: Path) -> PlanarBody:
        gather = Gather()
        self._check_options(gather)
        mesh = gather("", self._mesh, base)
        gather.check()
        assert mesh is not None
        held = gather("", self._held, mesh)
        T0 = gather("", self._initial_temperature, mesh)
        gather.check()
        m = scalar_mass(mesh, self.material.rho * self.thickness)
        X = mesh.points[:, 0] + 1j * mesh.points[:, 1]
        weights = np.asarray(m.sum(axis=1)).ravel()
        return PlanarBody(
            name=name, X=X, mass=float(weights.sum()), moment=complex(weights @ X),
            inertia=float(np.vdot(X, m @ X).real), pose=self.pose.coordinates(),
            velocity=self.pose.rates(), moves=self.frame == "floating",
            points=mesh.point_sets, mesh=mesh, thickness=self.thickness, mass_matrix=m,
            elasticity=None if held is None else self._elasticity(mesh, m, held),
            heat=self._heat(mesh) if "thermal" in self.fields else None, T0=T0,
            T_ref=np.full(len(X), self.reference_temperature),
        )

    def _mesh(self, base: Path) -> Mesh:
        try:
            mesh = self.mesh.build(base)
        except InputError as error:
            raise error.under("mesh") from None
        check_mesh(mesh)  # its faults have the key "mesh"
        if mesh.dimension != 2:
            raise InputError(f"the mesh is {mesh.dimension}-D; this body is plane", "mesh")
        try:
            return with_sets(mesh, self.sets)
        except InputError as error:
            raise error.under("sets") from None

    def _check_options(self, gather: Gather) -> None:
        """What can be said without a mesh."""
        if "elastic" in self.fields:
            if self.reference is None:
                gather.faults.append(Fault(
                    "reference", "missing: the elastic field needs a reference condition, such as "
                    "{clamp: left} or {chord: [a, b]}, or its displacements hold rigid motion"))
            gather("material", require, self.material, ("E", "nu"), "elastic")
        if "thermal" in self.fields:
            gather("material", require, self.material, ("k", "c"), "thermal")

    def _held(self, mesh: Mesh) -> IntArray | None:
        """Numbers of the displacements that are zero, None without an elastic field."""
        if "elastic" not in self.fields or self.reference is None:
            return None
        return self.reference.held(mesh)

    def _elasticity(self, mesh: Mesh, m: Any, held: IntArray) -> Elasticity:
        K = elastic_stiffness(mesh, self.material, self.thickness, self.model)
        M = csr_array(_blockwise(m))
        return Elasticity(
            free=np.setdiff1d(np.arange(2 * len(mesh.points)), held), stiffness=K,
            damping=csr_array(self.damping.mass * M + self.damping.stiffness * K),
            coupling=thermoelastic_coupling(mesh, self.material, self.thickness, self.model),
            law=law(self.material, self.model))

    def _heat(self, mesh: Mesh) -> Heat:
        k, c = require(self.material, ("k", "c"), "thermal")
        return Heat(
            free=np.arange(len(mesh.points)),
            capacity=capacity(mesh, self.material.rho, c, self.thickness),
            conductivity=conductivity(mesh, k, self.thickness),
            constants=(self.material.rho * c * self.thickness, k * self.thickness))

    def _initial_temperature(self, mesh: Mesh) -> FloatArray:
        given = self.initial_temperature
        n = len(mesh.points)
        if given is None:
            return np.full(n, self.reference_temperature)
        if isinstance(given, str):
            return evaluate_formula(given, mesh.points, "initial_temperature")
        return np.full(n, float(given))


def _blockwise(m: Any) -> Any:
    from scipy.sparse import kron

    return kron(m, np.eye(2), format="csr")
