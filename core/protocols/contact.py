"""Contacts: the plugin of a scene's entry, the built contact, its abilities, and its laws."""

from collections.abc import Mapping, Sequence
from typing import Literal, Protocol, runtime_checkable

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.contributions import Equations
from sparsemor.core.protocols.part import Part
from sparsemor.core.protocols.prescribed_motion import FrameHistory, SurfaceLoads

Surfaces = Literal["rigid", "deformed"]
"""Surfaces of a contact: as the rigid motion places them, or with displacements."""


class ContactPlugin(Protocol):
    """A contact of the scene, built once its bodies are. InputError keys are relative to its own
    entry (`between`)."""

    def build(self, name: str, parts: Mapping[str, Part]) -> "Contact": ...


class Contact(Part, Protocol):
    """A built contact: local terms that couple bodies inside the step; `blocks` is empty."""


@runtime_checkable
class DeclaresSurfaces(Protocol):
    """A contact plugin that states which surfaces it uses; without it, "rigid"."""

    @property
    def surfaces(self) -> Surfaces: ...


@runtime_checkable
class NamesSides(Protocol):
    """A contact plugin that names its two sides, so that elastic bodies among them are known."""

    @property
    def between(self) -> Sequence[str]:
        """`body:set` of each side."""
        ...


@runtime_checkable
class ImportsMotion(Protocol):
    """A built contact that can be evaluated along a prescribed motion, as two stages need."""

    def imported(self, motion: Mapping[str, FrameHistory]) -> Mapping[str, SurfaceLoads]:
        """Body -> nodal forces in its own axes (N) and nodal heat (W) at each time."""
        ...

    def history(self, motion: Mapping[str, FrameHistory]) -> Mapping[str, FloatArray]:
        """Name of a resultant -> (T,) values at the times of the motion."""
        ...


@runtime_checkable
class ConductsHeat(Protocol):
    """A built contact that conducts heat between surfaces whose motion is prescribed."""

    def conduction(self, equations: Equations, motion: Mapping[str, FrameHistory]) -> None:
        """Contributes the conduction along a prescribed motion of each body."""
        ...


@runtime_checkable
class ReportsNoContact(Protocol):
    """A built contact that notes when its surfaces never met."""

    def missed(self, motion: Mapping[str, FrameHistory]) -> str:
        """A warning by the motion of each body at all steps, "" where there is none."""
        ...


@runtime_checkable
class ReportsChatter(Protocol):
    """A built contact that notes when its forces do not settle."""

    def chatter_warning(self, history: Mapping[str, FloatArray]) -> str:
        """A warning by its resultants at all steps, "" where there is none."""
        ...


@runtime_checkable
class ReportsPassage(Protocol):
    """A built contact that notes when its surfaces pass each other in too few steps."""

    def passage(self, motion: Mapping[str, FrameHistory]) -> str:
        """A warning by the motion of each body at all steps, "" where there is none."""
        ...


class NormalLaw(Protocol):
    """Pressure (Pa) between two surfaces: force per area, whatever the size of a facet.

    breaks: penetrations above 0 (m, increasing) where a derivative jumps; quadrature splits there.
    """

    @property
    def breaks(self) -> tuple[float, ...]: ...
    def pressure(
        self, depth: FloatArray, rate: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pressure and its derivatives by penetration depth > 0 (m) and its rate (m/s), all of one
        shape. Surfaces do not pull: a negative pressure is taken for none."""
        ...


class FrictionLaw(Protocol):
    """Friction traction over pressure. breaks: slip speeds (m/s) where a derivative jumps."""

    @property
    def breaks(self) -> tuple[float, ...]: ...
    def ratio(self, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Friction coefficient with the sign of the slip velocity (m/s), which the traction
        opposes, and its derivative, s/m. In space the argument is the slip speed, at least 0, and
        the traction acts along the slip."""
        ...
