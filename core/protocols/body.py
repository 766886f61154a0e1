"""Bodies: the plugin of a scene's entry, the built body, and its optional abilities."""

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


class Material(Protocol):
    """Constants of an isotropic linear thermoelastic material, the same at all temperatures.

    rho: density, kg/m3; E: Young's modulus, Pa, and nu: Poisson's ratio, for elastic fields; alpha:
    linear thermal expansion, 1/K; k: conductivity, W/(m K), and c: specific heat, J/(kg K), for
    thermal fields. None where the material does not have a constant: a body with a field that needs
    it is refused.
    """

    @property
    def rho(self) -> float: ...
    @property
    def E(self) -> float | None: ...
    @property
    def nu(self) -> float | None: ...
    @property
    def alpha(self) -> float: ...
    @property
    def k(self) -> float | None: ...
    @property
    def c(self) -> float | None: ...


@dataclass(frozen=True, slots=True, eq=False)
class ProbePlace:
    """One probe as rows on the unknowns of its body.

    point (d,) body-frame position of the undeformed point, m; displacement (n, d) weights on the
    elastic block; temperature (m,) weights on the thermal block; base: temperature when the
    point's own is not an unknown (K, a function of time), or None when the body has no heat. pose
    (3,): of a frame that does not move, unless it follows `guide`.
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
class BodyShape:
    """The mesh of one body and how its unknowns sit on it.

    points (N, d) reference positions, m; cells (E, d + 1). elastic_dofs (n,): flat position
    `d * node + component` of each elastic unknown; thermal_nodes (n,): node of each thermal
    unknown; None where the body has no such field. Nodes without an unknown take
    `eliminated_displacement` (N, d), m, or 0; `eliminated_temperature` (N,), K, or 0, unless they
    are among those of `given`: nodes, and the function of time that their temperature follows.
    pose: of the body's frame at the start, where a frame without unknowns stays unless it follows
    a stage.
    """

    points: FloatArray
    cells: IntArray
    elastic_dofs: IntArray | None = None
    thermal_nodes: IntArray | None = None
    eliminated_displacement: FloatArray | None = None
    eliminated_temperature: FloatArray | None = None
    pose: FloatArray | None = None
    given: tuple[tuple[IntArray, TimeFunction], ...] = ()

    def given_at(self, times: FloatArray) -> FloatArray:
        """(j, functions) given temperatures at times (j,), s."""
        return np.array([[f.value(float(t)) for _, f in self.given] for t in times])

    @property
    def given_of(self) -> IntArray:
        """(N,): which of `given` each node follows, -1 for none."""
        which: IntArray = np.full(len(self.points), -1, np.int64)
        for i, (nodes, _) in enumerate(self.given):
            which[nodes] = i
        return which


class BodyPlugin(Protocol):
    """A body of the scene. base: folder of the scene file, for relative paths."""

    def build(self, name: str, base: Path) -> Body: ...


class Body(Part, Protocol):
    """A built body: what the assembly of a model reads from it.

    initial: block name -> (x, v) at the start; geometry: reducible block name -> node coordinates
    (n, d), m, and component (n,) of its unknowns. `BodyDefaults` has both for a body that
    starts at rest at zero and has no reducible blocks.
    """

    def initial(self) -> Mapping[str, tuple[FloatArray, FloatArray]]: ...
    def geometry(self) -> Mapping[str, tuple[FloatArray, IntArray]]: ...


class BodyDefaults:
    """Mix-in of a body at rest at zero, without reducible blocks."""

    def initial(self) -> Mapping[str, tuple[FloatArray, FloatArray]]:
        return {}

    def geometry(self) -> Mapping[str, tuple[FloatArray, IntArray]]:
        return {}


@runtime_checkable
class EstimatesSize(Protocol):
    """A body plugin with known counts: a run that does not fit in memory is refused unmeshed."""

    def expected(self) -> BodySize | None:
        """Counts of the body to be built, None where its options do not tell them."""
        ...


@runtime_checkable
class SelectsFields(Protocol):
    """A body plugin with an option `fields`; a rigid stage builds it with `fields: []`."""

    @property
    def fields(self) -> Sequence[str]:
        """Fields that the body has in addition to its rigid motion."""
        ...


@runtime_checkable
class HasProbes(Protocol):
    """A built body with material points. at: the name of a set, or body coordinates, m."""

    def probe(self, name: str, at: str | Sequence[float]) -> ProbePlace: ...


@runtime_checkable
class HasMesh(Protocol):
    """A built body with a mesh, whose content is part of the key of offline products."""

    @property
    def mesh(self) -> Mesh | None: ...


@runtime_checkable
class HasShape(Protocol):
    """A built body that can be drawn."""

    def shape(self) -> BodyShape | None:
        """Mesh and pose as results keep them; None for a body without a mesh."""
        ...


@runtime_checkable
class CopiesRigidly(Protocol):
    """A built body that makes its own rigid copy, without a second look at its mesh."""

    def rigid_copy(self) -> Body:
        """The same body without fields: rigid, with the mass and shape that it has."""
        ...


@runtime_checkable
class HasPose(Protocol):
    """A built body with a frame."""

    @property
    def pose(self) -> FloatArray:
        """(3,), (4,) or (7,) rigid coordinates at the start (see `poses`)."""
        ...


@runtime_checkable
class FollowsMotion(HasPose, Protocol):
    """A built body whose frame can follow a prescribed motion, as a rigid stage needs.

    moves: whether its frame has unknowns; idle: whether a force on it does nothing.
    """

    @property
    def moves(self) -> bool: ...
    @property
    def immobile(self) -> bool: ...
    def with_motion(self, motion: FrameHistory) -> Body:
        """The same body with a frame that follows the motion and has no unknowns."""
        ...


@runtime_checkable
class CarriesSurfaceLoads(Protocol):
    """A built body that takes tabulated loads on its surface, as contacts of a rigid stage make."""

    def surface_loads(
        self, equations: Equations, loads: SurfaceLoads, times: FloatArray
    ) -> None:
        """Contributes forces and heat on its surface at times (T,), s."""
        ...


@runtime_checkable
class ChangesBodies(Protocol):
    """A built joint or load that replaces bodies, such as one with prescribed temperatures."""

    @property
    def adjusted(self) -> Mapping[str, Body]:
        """Body name -> the body that takes its place; {} where nothing changes."""
        ...
