"""Galerkin reducer, for POD or any other basis: trial and test basis are the same, projected
offline."""

from collections.abc import Mapping, Sequence

from sparsemor.core import AssembledModel, Dictionary, Note
from sparsemor.reducers import (
    Maps,
    Projection,
    ProjectionReducer,
    Reducible,
    TestMap,
    modal_coordinates,
    projection_notes,
)


class Galerkin(ProjectionReducer):
    """Galerkin projection: the equations of each block projected onto its basis.

    The online cost is independent of the mesh, except for local terms (such as radiation), whose
    elements are all evaluated. Blocks that are solved separately (heat; displacements in prescribed
    frames) and have orthonormal atoms are solved in modal coordinates of their span.
    """

    def maps(self, block: Reducible) -> Maps:
        """Test map atoms^T (k, n) for operators and forces. norm: that in which the residual is
        least, with the operator D of a step; to be reported."""
        return Maps(TestMap(left=block.dictionary.atoms.T), facts={"norm": "D^-1"})

    def in_modes(
        self, model: AssembledModel, dictionaries: Mapping[str, Dictionary]
    ) -> Mapping[str, tuple[Dictionary, float]]:
        """Dictionaries of blocks in modal coordinates, in which their operators are diagonal, with
        the factors of their limits. Only where no border or other term mixes the modes, and not for
        blocks whose atoms are not orthonormal (`modal_coordinates`: None)."""
        s = model.separated
        if s.other:  # terms between blocks
            return {}
        modal = {b.thermal: modal_coordinates(
                      dictionaries[b.thermal], b.conductivity, b.capacity, "/s")
                  for b in s.heat}
        for m in s.moving:
            # border_size: number of rigid coordinates and joint forces
            if m.operators is not None and not s.border_size:
                o = m.operators
                modal[m.elastic] = modal_coordinates(
                    dictionaries[m.elastic], o.stiffness, o.mass, "Hz")
        return {name: found for name, found in modal.items() if found is not None}

    def notes_on(self, projection: Projection) -> Sequence[Note]:
        return projection_notes(projection)
