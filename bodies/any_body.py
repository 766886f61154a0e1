"""A built body of either dimension, for what does not ask for vectors."""

from typing import TypeAlias

from sparsemor.bodies.planar_body import PlanarBody
from sparsemor.bodies.spatial_body import SpatialBody

AnyBody: TypeAlias = PlanarBody | SpatialBody
