"""Fields of bodies in results: unknowns, and stress and strain that follow from them."""

from enum import Enum
from typing import TypeAlias

from sparsemor.core.protocols.layout import Quantity


class Derived(Enum):
    """Field that is computed from unknowns: von Mises `stress`, Pa, and equivalent `strain`."""

    STRESS = "stress"
    STRAIN = "strain"


Field: TypeAlias = Quantity | Derived
FIELDS: dict[str, Field] = {
    f.value: f for f in (Quantity.DISPLACEMENT, Quantity.TEMPERATURE, *Derived)}
"""Name of a field in files, options and charts -> field."""
