"""Bases among which the reducer `auto` chooses: functions that give the options of a basis, as in a
scene, for a number of atoms."""

from collections.abc import Callable, Mapping
from typing import Any

from sparsemor.core import Basis, BlockData, InputError, Registry
from sparsemor.reducers.reducer_options import counts_atoms

Source = Callable[[int], dict[str, Any]]
"""Number of atoms -> options of a basis, as in a scene."""
CONSTANT: Mapping[str, Any] = {"use": "modal", "count": 1}
"""Basis of a block that does not change: one mode and the initial values."""


def learned(basis: Basis) -> Source:
    """Bases as the scene's option `basis` describes it (a basis that is learned from snapshots),
    but with another number of atoms. Raises InputError for one without an option `count`."""
    if not counts_atoms(basis):
        raise InputError("auto needs a basis with an option for its number of atoms, `count`",
                         "basis")
    use = Registry().name_of("basis", type(basis))
    options = {k: v for k, v in basis.model_dump(mode="json").items()
             if k in basis.model_fields_set and k != "count"}
    return lambda k: {"use": use, **options, "count": k}


def responses(data: BlockData) -> Source:
    """Responses of a block to its load tables; for displacements, also the static responses to all
    loads that do not move."""
    def impulse(k: int) -> dict[str, Any]:
        return {"use": "impulse", "superposed": True, "count": k}

    if data.order == 1 or not data.loads.any():
        return impulse
    return lambda k: {"use": "dictionary", "orthonormal": True, "bases": ["static", impulse(k)]}
