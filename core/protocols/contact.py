"""Contracts of contacts, and of contact pressure and friction laws."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.body import Part
from sparsemor.core.protocols.connector import Connector, ConnectorPlugin
from sparsemor.core.protocols.contributions import Equations
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.protocols.prescribed_motion import FrameHistory, SurfaceLoads


class Contact(Connector):
    """A built contact: forces between bodies, surface element by surface element in each step.

    Along the motion of a rigid-body pre-simulation it is evaluated in advance. motion: body ->
    motion over all steps.
    """

    __slots__ = ()

    def imported(self, motion: Mapping[str, FrameHistory]) -> Mapping[str, SurfaceLoads] | None:
        """Surface loads by body along a prescribed motion: nodal forces in body axes (N) and nodal
        heat (W) at the times of the motion; None if it cannot be evaluated so."""
        return None

    def history(self, motion: Mapping[str, FrameHistory]) -> Mapping[str, FloatArray]:
        """Contact resultants by name ("normal" force, say), values (T,) at the times of the
        motion."""
        return {}

    def conduction(self, equations: Equations, motion: Mapping[str, FrameHistory]) -> None:
        """Adds the heat conduction along the prescribed motion of the bodies to the equations."""

    def missed(self, motion: Mapping[str, FrameHistory]) -> str:
        """Warning if its surfaces never touched, "" if there is none."""
        return ""

    def chatter_warning(self, history: Mapping[str, FloatArray]) -> str:
        """Warning if its forces oscillate from step to step (chatter), "" if there is none;
        history: name of a contact resultant -> values (T,) at all steps."""
        return ""

    def passage(self, motion: Mapping[str, FrameHistory]) -> str:
        """Warning if its surfaces pass each other within too few time steps, "" if there is
        none."""
        return ""


class ContactPlugin(ConnectorPlugin):
    """Options of a contact, from which `build` makes the contact once the bodies are built."""

    @abstractmethod
    def build(self, name: str, parts: Mapping[str, Part]) -> Contact: ...

    @property
    def deforms(self) -> bool:
        """True if its surfaces are deformed by the displacements, False if they move with the
        rigid-body motion only."""
        return False

    @property
    def sides(self) -> Sequence[str]:
        """Body and point set of each surface, as `body:set`, so that elastic bodies in contact are
        known in advance."""
        return ()


class NormalLaw(Plugin):
    """Contact law for the normal pressure (Pa) as a function of penetration and its rate."""

    @property
    def breaks(self) -> tuple[float, ...]:
        """Increasing penetrations > 0 (m) at which a derivative jumps; quadrature is split
        there."""
        return ()

    @abstractmethod
    def pressure(
        self, depth: FloatArray, rate: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pressure and its derivatives by penetration `depth` > 0 (m) and by penetration rate
        (m/s); three arrays of the shape of `depth`. Negative pressure (adhesion) is set to zero."""


class FrictionLaw(Plugin):
    """Friction law: ratio of friction traction to normal pressure."""

    @property
    def breaks(self) -> tuple[float, ...]:
        """Slip speeds (m/s) at which a derivative jumps."""
        return ()

    @property
    def bristles(self) -> tuple[float, int] | None:
        """Of a law with static friction, whose ratio may jump at zero slip: elastic deflection of
        the surfaces, m, from which they slip at rest, and largest number of patches that deflect;
        None for a law of the slip alone."""
        return None

    @abstractmethod
    def ratio(self, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Friction coefficient with the sign of the slip velocity (m/s), and its derivative, s/m;
        the traction opposes the slip. In 3-D the argument is the slip speed >= 0 and the traction
        acts along the slip direction."""
