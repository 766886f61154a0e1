"""POD-Galerkin (or any basis): trial and test map are the same atoms, compressed offline."""

from collections.abc import Mapping

from sparsemor.core.model import Model
from sparsemor.core.protocols import Dictionary
from sparsemor.reducers.natural import natural
from sparsemor.reducers.projected import Maps, Projected, Reducible
from sparsemor.reducers.test_map import TestMap


class Galerkin(Projected):
    """Online cost does not grow with the mesh, except for local terms, which are all visited.

    Blocks that are solved by themselves (heat; displacements in given frames) on orthonormal atoms
    have the natural modes of their span for coordinates.
    """

    def maps(self, block: Reducible) -> Maps:
        """atoms^T (k, n) for everything."""
        return Maps(TestMap(left=block.dictionary.atoms.T))

    def in_modes(
        self, model: Model, dictionaries: Mapping[str, Dictionary]
    ) -> Mapping[str, tuple[Dictionary, float]]:
        s = model.separated
        if s.other:
            return {}
        turned = {b.thermal: natural(dictionaries[b.thermal], b.conductivity, b.capacity, "/s")
                  for b in s.heat}
        for m in s.moving:
            if m.operators is not None and not s.border_size:
                o = m.operators
                turned[m.elastic] = natural(dictionaries[m.elastic], o.stiffness, o.mass, "Hz")
        return {name: found for name, found in turned.items() if found is not None}
