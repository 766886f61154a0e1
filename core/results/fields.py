"""Fields of bodies in results: unknowns, and stress and strain that follow from them."""

from enum import Enum
from typing import Protocol, TypeAlias

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.layout import Quantity


class Derived(Enum):
    """Field that is computed from unknowns: von Mises `stress`, Pa, and equivalent `strain`."""

    STRESS = "stress"
    STRAIN = "strain"


Field: TypeAlias = Quantity | Derived
FIELDS: dict[str, Field] = {
    f.value: f for f in (Quantity.DISPLACEMENT, Quantity.TEMPERATURE, *Derived)}
"""Name of a field in files, options and charts -> field."""


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
