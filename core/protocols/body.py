"""Interfaces of bodies: options of a body, the built body, and optional methods of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.contributions import Equations
from sparsemor.core.protocols.integrator import TimeFunction
from sparsemor.core.protocols.mesh import BodySize, Mesh
from sparsemor.core.protocols.part import Part
from sparsemor.core.protocols.prescribed_motion import FrameHistory, SurfaceLoads


@runtime_checkable
class TemperatureProperty(Protocol):
    """A material property as a function of temperature.

    limits: temperatures, K, between which it is defined; constant outside. degree: polynomial
    degree, or that of its pieces, for the choice of quadrature points.
    """

    @property
    def limits(self) -> tuple[float, float]: ...
    @property
    def degree(self) -> int: ...
    def at(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values and derivatives by temperature, of the shape of the temperatures T, K."""
        ...


@runtime_checkable
class HasNumbers(TemperatureProperty, Protocol):
    """A property that is also given by numbers; steps with laws of other properties are not
    compiled.

    numbers: a table (0, n, its n temperatures, then the first temperature, value and slope of each
    of its n + 1 segments), or a polynomial (1, n, T_0, least and greatest temperature, n
    coefficients in powers of T - T_0).
    """

    @property
    def numbers(self) -> FloatArray: ...


class Material(Protocol):
    """Isotropic linear thermoelastic material; properties are constants or functions of
    temperature.

    rho: density, kg/m3; E: Young's modulus, Pa, and nu: Poisson's ratio, for elastic fields; alpha:
    mean coefficient of linear thermal expansion from the reference temperature on, 1/K; k:
    conductivity, W/(m K), and c: specific heat, J/(kg K), for thermal fields. None for an undefined
    property; a body whose fields need it is refused.
    """

    @property
    def rho(self) -> float: ...
    @property
    def E(self) -> float | TemperatureProperty | None: ...
    @property
    def nu(self) -> float | None: ...
    @property
    def alpha(self) -> float | TemperatureProperty: ...
    @property
    def k(self) -> float | TemperatureProperty | None: ...
    @property
    def c(self) -> float | TemperatureProperty | None: ...


@dataclass(frozen=True, slots=True, eq=False)
class ProbePlace:
    """A material point whose motion and temperature are recorded, as weights on the unknowns of its
    body.

    point (d,): reference position in the body frame, m; displacement (n, d): weights on elastic
    unknowns; temperature (m,): weights on temperature unknowns; given: (weight, function of time)
    of prescribed temperatures, K. Weights are None for a field that the body lacks. pose: rigid
    coordinates of a fixed frame; guide: prescribed motion of the frame, or None.
    """

    name: str
    body: str
    point: FloatArray
    displacement: FloatArray | None
    temperature: FloatArray | None
    given: tuple[tuple[float, TimeFunction], ...]
    pose: FloatArray
    guide: FrameHistory | None = None


@dataclass(frozen=True, slots=True, eq=False)
class StressConstants:
    """Constants of the stress lam tr(eps) I + 2 mu eps - beta (T - T_free) I of a body.

    constants (R, 5): lam, mu, Pa, beta, Pa/K, and lam and beta of the stress across the plane, of
    each material; region (E,): material of each cell; free (N,): stress-free temperature T_free, K.
    nonlinear: True if eps is the Green-Lagrange strain and the stress is the second Piola-Kirchhoff
    stress.
    """

    constants: FloatArray
    region: IntArray
    free: FloatArray
    nonlinear: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class BodyShape:
    """Mesh of one body, and the nodes of its unknowns.

    points (N, d): reference positions, m; cells (E, 3, 4, 6 or 10): nodes of linear or quadratic
    triangles or tetrahedra. elastic_dofs (n,): `d * node + component` of each elastic unknown;
    thermal_nodes (n,): node of each temperature unknown; None without such a field. Nodes without
    unknowns have the displacement `eliminated_displacement` (N, d), m, or 0, and the temperature
    `eliminated_temperature` (N,), K, or 0, or one that is prescribed in `given`: nodes and their
    function of time. pose: initial rigid coordinates of the frame, constant unless the frame has
    unknowns or a prescribed motion. stress: constants of the stress, None where it is not a linear
    function of strain and temperature with constant coefficients.
    """

    points: FloatArray
    cells: IntArray
    elastic_dofs: IntArray | None = None
    thermal_nodes: IntArray | None = None
    eliminated_displacement: FloatArray | None = None
    eliminated_temperature: FloatArray | None = None
    pose: FloatArray | None = None
    given: tuple[tuple[IntArray, TimeFunction], ...] = ()
    stress: StressConstants | None = None

    def given_at(self, times: FloatArray) -> FloatArray:
        """Prescribed temperatures (j, functions), K, at times (j,), s."""
        return np.array([[f.value(float(t)) for _, f in self.given] for t in times])

    @property
    def given_of(self) -> IntArray:
        """Number of the prescribed temperature function of each node (N,), -1 for nodes without
        one."""
        which: IntArray = np.full(len(self.points), -1, np.int64)
        for i, (nodes, _) in enumerate(self.given):
            which[nodes] = i
        return which


class BodyPlugin(Protocol):
    """Options of a body, from which `build` makes the body. base: folder of the input file, for
    relative paths."""

    def build(self, name: str, base: Path) -> Body: ...


def immobile(plugin: object) -> bool:
    """True if a body plugin says, by its attribute `immobile`, that its body has no unknowns of
    motion, as one with heat alone in a fixed frame. A plugin that does not say may move."""
    return bool(getattr(plugin, "immobile", False))


class Body(Part, Protocol):
    """A built body, as read by the assembly of a model.

    initial: block of unknowns -> initial values and rates (x, v); geometry: elastic or thermal
    block -> node coordinates (n, d), m, and component (n,) of its unknowns. `BodyDefaults`
    implements both for a rigid body with zero initial values.
    """

    def initial(self) -> Mapping[str, tuple[FloatArray, FloatArray]]: ...
    def geometry(self) -> Mapping[str, tuple[FloatArray, IntArray]]: ...


class BodyDefaults:
    """Mix-in for bodies with zero initial values and without elastic or thermal fields."""

    def initial(self) -> Mapping[str, tuple[FloatArray, FloatArray]]:
        return {}

    def geometry(self) -> Mapping[str, tuple[FloatArray, IntArray]]:
        return {}


@runtime_checkable
class EstimatesSize(Protocol):
    """A body plugin that reports its numbers of unknowns and matrix entries before meshing, so that
    a run that does not fit in memory is refused early."""

    def expected(self) -> BodySize | None:
        """Expected numbers of unknowns and matrix entries; None if the options do not determine
        them."""
        ...


@runtime_checkable
class SelectsFields(Protocol):
    """A body plugin with an option `fields` (elastic, thermal); a rigid-body pre-simulation builds
    it with `fields: []`."""

    @property
    def fields(self) -> Sequence[str]:
        """Names of the fields of the body in addition to its rigid motion."""
        ...


@runtime_checkable
class HasProbes(Protocol):
    """A built body with material points whose motion can be recorded. at: name of a point set, or
    coordinates in the body frame, m."""

    def probe(self, name: str, at: str | Sequence[float]) -> ProbePlace: ...


@runtime_checkable
class HasMesh(Protocol):
    """A built body with a mesh, which is part of the cache key of offline results."""

    @property
    def mesh(self) -> Mesh | None: ...


@runtime_checkable
class HasShape(Protocol):
    """A built body with a mesh and pose that can be drawn."""

    def shape(self) -> BodyShape | None:
        """Mesh and pose as stored with the results; None for a body without a mesh."""
        ...


@runtime_checkable
class CopiesRigidly(Protocol):
    """A built flexible body that makes a rigid copy of itself without meshing again."""

    def rigid_copy(self) -> Body:
        """Rigid body with the same mass properties and geometry, without elastic and thermal
        fields."""
        ...


@runtime_checkable
class HasPose(Protocol):
    """A built body with a body frame."""

    @property
    def pose(self) -> FloatArray:
        """Initial rigid coordinates of the frame: (3,) planar, (4,) spinning about one axis, (7,)
        spatial (see `poses`)."""
        ...


@runtime_checkable
class FollowsMotion(HasPose, Protocol):
    """A built body whose frame can follow a prescribed motion, as after a rigid-body
    pre-simulation.

    moves: True if its frame has unknowns; immobile: True if a force on it has no effect.
    """

    @property
    def moves(self) -> bool: ...
    @property
    def immobile(self) -> bool: ...
    def with_motion(self, motion: FrameHistory) -> Body:
        """Copy of the body whose frame follows the prescribed motion and has no unknowns."""
        ...


@runtime_checkable
class LimitsTemperature(Protocol):
    """A built body with material properties that are defined in a range of temperatures."""

    @property
    def temperature_limits(self) -> Mapping[str, tuple[float, float]]:
        """Name of each property -> lowest and highest temperature, K."""
        ...


@runtime_checkable
class CarriesSurfaceLoads(Protocol):
    """A built body that accepts time-tabulated loads on its surface, such as contact forces of a
    rigid-body pre-simulation."""

    def surface_loads(
        self, equations: Equations, loads: SurfaceLoads, times: FloatArray
    ) -> None:
        """Adds nodal forces and heat at times (T,), s, on the surface of the body to the
        equations."""
        ...


@runtime_checkable
class ChangesBodies(Protocol):
    """A built joint or load that replaces bodies by modified ones, such as bodies with prescribed
    temperatures."""

    @property
    def adjusted(self) -> Mapping[str, Body]:
        """Body name -> modified body; {} if none changes."""
        ...
