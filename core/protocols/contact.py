"""Interfaces of contacts, of contact pressure and friction laws, and optional methods of
contacts."""

from collections.abc import Mapping, Sequence
from typing import Literal, Protocol, runtime_checkable

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.contributions import Equations
from sparsemor.core.protocols.part import Part
from sparsemor.core.protocols.prescribed_motion import FrameHistory, SurfaceLoads

Surfaces = Literal["rigid", "deformed"]
"""Surfaces used for contact: moved with the rigid-body motion only, or deformed by the
displacements."""


class ContactPlugin(Protocol):
    """Options of a contact, from which `build` makes the contact once the bodies are built. parts:
    bodies by name. InputError keys are relative to the contact's own input entry (`between`)."""

    def build(self, name: str, parts: Mapping[str, Part]) -> "Contact": ...


class Contact(Part, Protocol):
    """A built contact: forces between bodies, evaluated surface element by surface element within
    each step; it has no unknowns, `blocks` is empty."""


@runtime_checkable
class DeclaresSurfaces(Protocol):
    """A contact plugin that states whether it uses rigid or deformed surfaces; without it,
    "rigid"."""

    @property
    def surfaces(self) -> Surfaces: ...


@runtime_checkable
class NamesSides(Protocol):
    """A contact plugin that names its two surfaces, so that elastic bodies in contact are known in
    advance."""

    @property
    def between(self) -> Sequence[str]:
        """Body and point set of each surface, as `body:set`."""
        ...


@runtime_checkable
class ImportsMotion(Protocol):
    """A built contact that can be evaluated along a prescribed motion, as after a rigid-body
    pre-simulation."""

    def imported(self, motion: Mapping[str, FrameHistory]) -> Mapping[str, SurfaceLoads]:
        """Surface loads by body: nodal forces in body axes (N) and nodal heat (W) at the times of
        the motion."""
        ...

    def history(self, motion: Mapping[str, FrameHistory]) -> Mapping[str, FloatArray]:
        """Contact resultants by name ("normal" force, say), values (T,) at the times of the
        motion."""
        ...


@runtime_checkable
class ConductsHeat(Protocol):
    """A built contact that conducts heat between surfaces whose motion is prescribed."""

    def conduction(self, equations: Equations, motion: Mapping[str, FrameHistory]) -> None:
        """Adds the heat conduction along the prescribed motion of the bodies to the equations."""
        ...


@runtime_checkable
class ReportsNoContact(Protocol):
    """A built contact that warns if its surfaces never touched."""

    def missed(self, motion: Mapping[str, FrameHistory]) -> str:
        """Warning, "" if there is none; motion: body -> motion over all steps."""
        ...


@runtime_checkable
class ReportsChatter(Protocol):
    """A built contact that warns if its forces oscillate from step to step (chatter)."""

    def chatter_warning(self, history: Mapping[str, FloatArray]) -> str:
        """Warning, "" if there is none; history: name of a contact resultant -> values (T,) at all
        steps."""
        ...


@runtime_checkable
class ReportsPassage(Protocol):
    """A built contact that warns if its surfaces pass each other within too few time steps."""

    def passage(self, motion: Mapping[str, FrameHistory]) -> str:
        """Warning, "" if there is none; motion: body -> motion over all steps."""
        ...


class NormalLaw(Protocol):
    """Contact law for the normal pressure (Pa) as a function of penetration and its rate.

    breaks: increasing penetrations > 0 (m) at which a derivative jumps; quadrature is split there.
    """

    @property
    def breaks(self) -> tuple[float, ...]: ...
    def pressure(
        self, depth: FloatArray, rate: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pressure and its derivatives by penetration `depth` > 0 (m) and by penetration rate
        (m/s); three arrays of the shape of `depth`. Negative pressure (adhesion) is set to zero."""
        ...


class FrictionLaw(Protocol):
    """Friction law: ratio of friction traction to normal pressure. breaks: slip speeds (m/s) at
    which a derivative jumps."""

    @property
    def breaks(self) -> tuple[float, ...]: ...
    def ratio(self, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Friction coefficient with the sign of the slip velocity (m/s), and its derivative, s/m;
        the traction opposes the slip. In 3-D the argument is the slip speed >= 0 and the traction
        acts along the slip direction."""
        ...
