"""Contracts of bodies: options of a body, and the built body; materials."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.notes import Note
from sparsemor.core.protocols.contributions import Equations
from sparsemor.core.protocols.layout import Block, FieldKind, Quantity
from sparsemor.core.protocols.mesh import BodySize, Mesh
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.protocols.poses import FREE_POSE, PLANAR_POSE, vectors_in_space
from sparsemor.core.protocols.prescribed_motion import FrameHistory, SurfaceLoads
from sparsemor.core.protocols.separable import Amplitude
from sparsemor.core.protocols.time_function import TimeFunction


class Part(ABC):
    """A built body, joint, contact or load: the numerical object made from one entry of the input.

    name: key of the entry. blocks: its own unknowns, one block per field. contribute: adds its
    terms to the equations.
    """

    __slots__ = ()
    name: str

    def blocks(self) -> Sequence[Block]:
        """Its own unknowns, one block per field; by default none."""
        return ()

    @abstractmethod
    def contribute(self, equations: Equations) -> None:
        """Adds matrices, loads, forces and constraints to the equations of named blocks of unknowns
        (see `core.protocols.contributions`)."""

    @property
    def notes(self) -> tuple[Note, ...]:
        """Warnings on valid but suspicious options."""
        return ()

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(12)


class TemperatureProperty(ABC):
    """A material property as a function of temperature.

    limits: temperatures, K, between which it is defined; constant outside. degree: polynomial
    degree, or that of its pieces, for the choice of quadrature points.
    """

    __slots__ = ()

    @property
    @abstractmethod
    def limits(self) -> tuple[float, float]: ...
    @property
    @abstractmethod
    def degree(self) -> int: ...
    @abstractmethod
    def at(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values and derivatives by temperature, of the shape of the temperatures T, K."""

    def integral(self, T: FloatArray) -> FloatArray:
        """Integral over temperature from a constant lower limit to T, K, of the shape of T: of a
        specific heat the heat content, J/kg. By default of 12 Gauss points within the limits, and
        beyond them with the constant value there."""
        low, high = self.limits
        inside = np.clip(T, low, high)
        half = 0.5 * (inside - low)
        points = low + half[..., None] * (1.0 + _POINTS)
        within = half * (self.at(points)[0] @ _WEIGHTS)
        return np.asarray(within + self.at(inside)[0] * (T - inside))

    @property
    def numbers(self) -> FloatArray | None:
        """The property by numbers; steps with laws of properties without them are not compiled.

        A table (0, n, its n temperatures, then the first temperature, value and slope of each of
        its n + 1 segments), or a polynomial (1, n, T_0, least and greatest temperature, n
        coefficients in powers of T - T_0).
        """
        return None


@dataclass(frozen=True, eq=False)
class MaterialProperties:
    """Properties of a material, constants or functions of temperature.

    rho: density, kg/m3; E: Young's modulus, Pa, and nu: Poisson's ratio, for elastic fields; alpha:
    mean coefficient of linear thermal expansion from the reference temperature on, 1/K; k:
    conductivity, W/(m K), and c: specific heat, J/(kg K), for thermal fields. None for an undefined
    property; a body whose fields need it is refused.
    """

    rho: float
    E: float | TemperatureProperty | None = None
    nu: float | None = None
    alpha: float | TemperatureProperty = 0.0
    k: float | TemperatureProperty | None = None
    c: float | TemperatureProperty | None = None


@dataclass(frozen=True, eq=False)
class DirectionalProperties:
    """Constant properties of a material that depend on the direction, in body axes; components xx,
    yy, zz, yz, zx, xy, shear strains twice the tensor's.

    stiffness (6, 6): Pa; expansion (6,): thermal strain, 1/K; conductivity (3, 3): W/(m K). None
    for an undefined property.
    """

    stiffness: FloatArray | None
    expansion: FloatArray
    conductivity: FloatArray | None


class Material(Plugin):
    """Linear thermoelastic material, isotropic unless it is `directional`."""

    @abstractmethod
    def properties(self) -> MaterialProperties:
        """Its properties, constants or functions of temperature."""

    def directional(self) -> DirectionalProperties | None:
        """Properties in the place of E, nu, alpha and k that depend on the direction; None for an
        isotropic material."""
        return None


@dataclass(frozen=True, slots=True, eq=False)
class ProbeStress:
    """Stress at a probe: displacement (n, 6): weights on elastic unknowns; temperature (m, 6): on
    temperature unknowns, None without them; base (6,), Pa; given: weights (6,) and functions of
    time of prescribed temperatures. Components xx, yy, zz, xy, yz, xz, in body axes."""

    displacement: FloatArray
    temperature: FloatArray | None
    base: FloatArray
    given: tuple[tuple[FloatArray, TimeFunction], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class ProbePlace:
    """A material point whose motion and temperature are recorded, as weights on the unknowns of its
    body.

    point (d,): reference position in the body frame, m; displacement (n, d): weights on elastic
    unknowns; temperature (m,): weights on temperature unknowns; given: (weight, function of time)
    of prescribed temperatures, K. Weights are None for a field that the body lacks. pose: rigid
    coordinates of a fixed frame; guide: prescribed motion of the frame, or None. stress: the stress
    there, if it is recorded.
    """

    name: str
    body: str
    point: FloatArray
    displacement: FloatArray | None
    temperature: FloatArray | None
    given: tuple[tuple[float, TimeFunction], ...]
    pose: FloatArray
    guide: FrameHistory | None = None
    stress: ProbeStress | None = None

    def without_mesh(self) -> ProbePlace:
        """Copy without weights of the mesh's size."""
        constants = None if self.stress is None else replace(
            self.stress, displacement=np.zeros((0, 6)), temperature=None)
        return replace(self, displacement=None, temperature=None, stress=constants)

    @property
    def functions(self) -> tuple[tuple[object, TimeFunction], ...]:
        """Weights and functions of time of prescribed temperatures on which it depends."""
        return (*self.given, *(() if self.stress is None else self.stress.given))


@dataclass(frozen=True, slots=True, eq=False)
class StressConstants:
    """Constants of the stress lam tr(eps) I + 2 mu eps - beta (T - T_free) I of a body.

    constants (R, 5): lam, mu, Pa, beta, Pa/K, and lam and beta of the stress across the plane, of
    each material, and of a body of revolution a sixth, 1; region (E,): material of each cell; free
    (N,): stress-free temperature T_free, K. nonlinear: True if eps is the Green-Lagrange strain and
    the stress is the second Piola-Kirchhoff stress.
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
    `eliminated_temperature` (N,), K, or 0, or sums of shape * f(t) in `given`: nodes,
    f, shape. pose: initial rigid coordinates of the frame, constant unless the frame has
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
    given: tuple[tuple[IntArray, TimeFunction, FloatArray], ...] = ()
    stress: StressConstants | None = None

    def given_at(self, times: FloatArray) -> FloatArray:
        """Functions of prescribed temperatures (j, functions) at times (j,), s."""
        return np.array([[f.value(float(t)) for _, f, _ in self.given] for t in times])

    @property
    def given_shapes(self) -> FloatArray:
        """Share of each function in the prescribed temperature of each node (N, functions)."""
        found = np.zeros((len(self.points), len(self.given)))
        for i, (nodes, _, shape) in enumerate(self.given):
            found[nodes, i] = shape
        return found


@dataclass(frozen=True, slots=True, eq=False)
class MeanTemperature:
    """Mean temperature of a set of points, K: weights (n,) times the unknown temperatures, plus
    each weight times a prescribed temperature in `given`."""

    weights: FloatArray
    given: tuple[tuple[float, TimeFunction], ...] = ()


class StressRecovery(Protocol):
    """Strain and stress of one body at P points from its displacements u (N, d), m, and
    temperatures above the stress-free ones (N,), K; made by the plugin of the body.

    nodes (P,): node of each point; own (E, q): points of each cell.
    """

    nodes: IntArray
    own: IntArray

    def strain(self, u: FloatArray, heating: FloatArray) -> FloatArray:
        """(P, 3, 3) strain."""
        ...

    def stress(self, u: FloatArray, heating: FloatArray) -> FloatArray:
        """(P, 3, 3) Cauchy stress, Pa."""
        ...

    def von_mises(self, u: FloatArray, heating: FloatArray) -> FloatArray:
        """(P,) von Mises stress, Pa."""
        ...

    def equivalent_strain(self, u: FloatArray, heating: FloatArray) -> FloatArray:
        """(P,) equivalent strain."""
        ...


class BodyPlugin(Plugin):
    """Options of a body, from which `build` makes the body. base: folder of the input file, for
    relative paths.

    field_kinds: kinds of fields that its bodies may have; result tables of parameter studies have
    columns for them.
    """

    field_kinds: ClassVar[tuple[FieldKind, ...]] = ()

    @abstractmethod
    def build(self, name: str, base: Path) -> Body: ...

    @property
    def immobile(self) -> bool:
        """True if its body has no unknowns of motion, as one with heat alone in a fixed frame."""
        return False

    @property
    def selected_fields(self) -> Sequence[str] | None:
        """Names of the fields of the body in addition to its rigid motion, if the option `fields`
        selects them: a rigid-body pre-simulation then builds it with `fields: []`. None without
        this option."""
        return None

    @classmethod
    def stress_recovery(
        cls, points: FloatArray, cells: IntArray, constants: FloatArray, region: IntArray,
        nonlinear: bool,
    ) -> StressRecovery | None:
        """Strain and stress of a stored body: points (N, d), cells, and the constants and regions
        of its `StressConstants`; nonlinear: True for Green-Lagrange strains; None for bodies
        without stresses."""
        return None

    def expected(self) -> BodySize | None:
        """Numbers of unknowns and matrix entries before meshing, so that a run that does not fit in
        memory is refused early; None if the options do not determine them."""
        return None


class Body(Part):
    """A built body, as read by the assembly of a model and by joints and loads.

    pose: initial rigid coordinates of its frame: (3,) planar, (4,) spinning about one axis, (7,)
    spatial (see `poses`). A body follows a prescribed motion, as after a rigid-body pre-simulation,
    if `with_motion` returns one that does.
    """

    __slots__ = ()
    pose: FloatArray

    def initial(self) -> Mapping[str, tuple[FloatArray, FloatArray]]:
        """Block of unknowns -> initial values and rates (x, v); zero for blocks without."""
        return {}

    def geometry(self) -> Mapping[str, tuple[FloatArray, IntArray]]:
        """Reducible block -> node coordinates (n, d), m, and component (n,) of its unknowns:
        0..d-1 for displacements, d and up for rotations, -1 for modal coordinates, each of which
        is a node, 0 for temperatures."""
        return {}

    # ------------------------------------------------------------------ motion of its frame

    @property
    def moves(self) -> bool:
        """True if the rigid coordinates of its frame are unknowns."""
        return any(b.size and b.kind.quantity is Quantity.POSE for b in self.blocks())

    @property
    def guide(self) -> FrameHistory | None:
        """Prescribed motion of its frame, None if there is none."""
        return None

    @property
    def flexible(self) -> bool:
        """True if it has displacements that are unknowns."""
        return any(b.size and b.kind.quantity is Quantity.DISPLACEMENT for b in self.blocks())

    @property
    def immobile(self) -> bool:
        """True if a force on the body has no effect: it neither moves nor deforms."""
        return not self.moves and not self.flexible and self.guide is None

    def with_motion(self, motion: FrameHistory) -> Body | None:
        """Copy of the body whose frame follows the prescribed motion and has no unknowns; None if
        it cannot."""
        return None

    def rigid_copy(self) -> Body | None:
        """Rigid body with the same mass properties and geometry, without elastic and thermal
        fields, made without meshing again; None if it is built anew for that."""
        return None

    @property
    def without_fields(self) -> bool:
        """True for a rigid copy of a body that has fields."""
        return False

    # ------------------------------------------------------------------ points for joints and loads

    @property
    def d(self) -> int:
        """Dimension: 2 or 3."""
        return 2 if len(self.pose) == PLANAR_POSE else 3

    @property
    def turns_freely(self) -> bool:
        """True if the attitude of its frame is a quaternion, not an angle."""
        return len(self.pose) == FREE_POSE

    def start_rotation(self) -> FloatArray:
        """(d, d) initial rotation matrix from body axes to space axes."""
        return np.stack([vectors_in_space(self.pose[None], e)[0] for e in np.eye(self.d)], axis=1)

    @property
    def extent(self) -> float:
        """Length, m, to which gaps between the sides of a joint are compared."""
        return 0.0

    def point_of(self, which: str, key: str) -> FloatArray:
        """(d,) reference position, in the body frame, m, of the centre of a named set of points,
        where joints and forces act. InputError under `key` with the names of the existing sets."""
        raise InputError(f"body {self.name!r} has no sets of points", key)

    def point_in_words(self, which: str) -> str:
        """How the centre of a set is determined, for messages; "" if there is nothing to say."""
        return ""

    def displacement_of(self, which: str) -> FloatArray | None:
        """(n, d) derivatives of the displacement of the centre of a set, body axes, by the n
        unknown displacements; None on a rigid body."""
        return None

    def rotation_of(self, which: str, key: str) -> FloatArray | None:
        """(n, 1 or 3) derivatives of the rotation of a set relative to the body frame, rad, by the
        n unknown displacements; None if they do not turn it. InputError under `key` where the
        rotation is undefined."""
        return None

    def deforms_at(self, which: str) -> bool:
        """True if unknown displacements move points of a set."""
        moved = self.displacement_of(which)
        return moved is not None and bool(moved.any())

    def temperature_of(self, which: str) -> MeanTemperature | None:
        """Mean temperature of a set; None on a body without temperatures."""
        return None

    # ------------------------------------------------------------------ loads

    def gravity(self, equations: Equations, g: FloatArray, amplitude: Amplitude) -> None:
        """Adds the weight of the body, with the acceleration g (d,), m/s2, times an amplitude; by
        default nothing, for a body without mass."""

    def surface_loads(self, equations: Equations, loads: SurfaceLoads, times: FloatArray) -> bool:
        """Adds nodal forces and heat at times (T,), s, on the surface of the body, such as contact
        forces of a rigid-body pre-simulation; False if it does not accept such loads."""
        return False

    # ------------------------------------------------------------------ results and checks

    def probe(self, name: str, at: str | Sequence[float]) -> ProbePlace | None:
        """Material point whose motion is recorded, given by a point set, or by coordinates in the
        body frame, m; None if the body has no such points."""
        return None

    def stress_at(self, at: str | Sequence[float]) -> ProbeStress | None:
        """Stress at a point that `probe` takes; None where it is no linear function of
        displacements and temperatures."""
        return None

    @property
    def total_mass(self) -> float | None:
        """Mass, kg; None if it has none or does not report it."""
        return None

    @property
    def set_sizes(self) -> Mapping[str, int]:
        """Set of points -> number of its points."""
        return {}

    @property
    def mesh(self) -> Mesh | None:
        """Its mesh, which is part of the cache key of offline results; None without one."""
        return None

    def shape(self) -> BodyShape | None:
        """Mesh and pose for pictures, stored with the results; None for a body without a mesh."""
        return None

    @property
    def temperature_limits(self) -> Mapping[str, tuple[float, float]]:
        """Name of each material property -> lowest and highest temperature, K, of its range."""
        return {}
