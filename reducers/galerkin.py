"""POD-Galerkin (or any basis): trial and test map are the same atoms, compressed offline."""

from sparsemor.reducers.projected import Maps, Projected, Reducible
from sparsemor.reducers.test_map import TestMap


class Galerkin(Projected):
    """Online cost does not grow with the mesh, except for local terms, which are all visited."""

    def maps(self, block: Reducible) -> Maps:
        """atoms^T (k, n) for everything."""
        return Maps(TestMap(left=block.dictionary.atoms.T))
