"""What acts between two surfaces."""

from typing import Protocol

from sparsemor.core.arrays import FloatArray


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
        """Of the sign of the slip velocity (m/s), which it opposes; and its derivative, s/m. In
        space it is asked with the slip's speed, at least 0, and acts along the slip."""
        ...
