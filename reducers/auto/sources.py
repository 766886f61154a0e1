"""Bases among which the reducer `auto` chooses, as options of a scene that depend on the number of
atoms."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sparsemor.core import Basis, BlockData, InputError, Plugin, Registry
from sparsemor.reducers.field_options import CountsAtoms

Source = Callable[[int], dict[str, Any]]
"""Number of atoms -> options of a basis, as in a scene."""
CONSTANT: Mapping[str, Any] = {"use": "modal", "count": 1}
"""Basis of a block that does not change: one mode and the initial values."""
SUBSTEPS = 4
"""Steps from one delay to the next in the impulse responses."""


def learned(basis: Basis) -> Source:
    """The basis of the option `basis`, with another number of atoms. Raises InputError for one
    without such an option."""
    if not (isinstance(basis, CountsAtoms) and isinstance(basis, Plugin)):
        raise InputError("auto needs a basis with an option for its number of atoms, `count`",
                         "basis")
    use = Registry().name_of("basis", type(basis))
    given = {k: v for k, v in basis.model_dump(mode="json").items()
             if k in basis.model_fields_set and k != "count"}
    return lambda k: {"use": use, **given, "count": k}


def pulses(heat: BlockData, tail: float) -> Source:
    """Impulse responses to the load tables of a thermal block, truncated at `tail`."""
    shapes = table_rank(heat, tail)
    return lambda k: {"use": "impulse", "tabled": shapes, "substeps": SUBSTEPS, "count": k}


def attached(data: BlockData, tail: float, most: int) -> Source:
    """Static responses of displacements to load tables, to the impulse responses of the body's
    temperatures, of which there are `most`, and to all loads that do not move."""
    moving = [d for d in (data, data.heat) if d is not None and d.moving]
    shapes = max(table_rank(d, tail) for d in moving)
    own: dict[str, Any] = {"use": "attachment", "tabled": shapes}
    if data.heat is not None and data.heat.moving:
        own["thermal"] = pulses(data.heat, tail)(most)
    rest = ["static"] if data.loads.any() else []
    return lambda k: {"use": "dictionary", "orthonormal": True,
                      "bases": [*rest, {**own, "count": k}]}


def table_rank(data: BlockData, tail: float) -> int:
    """Number of singular vectors of the load tables of a block, the largest over its loads, whose
    rest is at most `tail` of the whole (Frobenius norm)."""
    most = 1
    for load in data.moving:
        V = load.table.values
        # squares of the singular values, of which those below 1e-14 are round-off
        squares = np.linalg.eigvalsh(V @ V.T if len(V) < V.shape[1] else V.T @ V)
        rest = np.cumsum(np.maximum(squares, 0.0))
        most = max(most, int(np.count_nonzero(rest > max(tail**2, 1e-14) * rest[-1])))
    return most
