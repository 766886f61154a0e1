"""A built body of either dimension, for what does not ask for vectors."""

from typing import TypeAlias

from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.spatial.body import SpatialBody

AnyBody: TypeAlias = PlanarBody | SpatialBody
