"""A surface made of facets, ready for contact: what is the same in the plane and in space."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, Self, TypeVar

import numpy as np

from sparsemor.bodies.any_body import AnyBody
from sparsemor.core.arrays import FloatArray, IntArray

B = TypeVar("B", bound=AnyBody)


@dataclass(frozen=True, eq=False)
class Facets(ABC, Generic[B]):
    """nodes (n,): sorted point numbers of the body; facets (F, d): positions in `nodes`, ordered
    so that the outward side is told (fe/surface.py)."""

    body: B
    nodes: IntArray
    facets: IntArray

    @classmethod
    def of(cls, body: B, facets: IntArray) -> Self:
        """facets (F, d): point numbers, outward ordered (fe/surface.py)."""
        nodes = np.unique(facets)
        return cls(body, nodes, np.searchsorted(nodes, facets))

    def some(self, chosen: IntArray) -> tuple[Self, IntArray]:
        """Some of the facets with the cells that they have among all, and which nodes are theirs.
        """
        used = np.unique(self.facets[chosen])
        part = type(self)(self.body, self.nodes[used], np.searchsorted(used, self.facets[chosen]))
        part.__dict__.update(self._cells_of(chosen), radius=self.radius)
        return part, used

    @abstractmethod
    def _cells_of(self, chosen: IntArray) -> Mapping[str, Any]:
        """Properties of some facets that depend on their neighbours among all."""

    @property
    @abstractmethod
    def sizes(self) -> FloatArray:
        """(F,) shortest extent of each facet, m."""

    @property
    @abstractmethod
    def radius(self) -> float:
        """Largest distance of a facet's point from its middle, m."""

    @property
    @abstractmethod
    def tree(self) -> Any:
        """Over the middles of the facets in the body frame."""
