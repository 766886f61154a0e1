"""Dictionaries of all reducible blocks, and local terms under the maps."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model import Model
from sparsemor.core.offline import Offline
from sparsemor.core.protocols import Basis, Dictionary, ReducedTerm, Trial
from sparsemor.core.separable import HeatBody

GROWTH = 1e3
"""Coefficients this many times beyond the largest of the training run are called divergence."""


def represent(
    offline: Offline, bases: Mapping[str, Basis]
) -> tuple[dict[str, Dictionary], dict[str, float]]:
    """One dictionary a block, and the largest coefficient that is still sane.

    InputError names the block whose basis cannot be built.
    """
    found, limits = {}, {}
    for name, basis in bases.items():
        try:
            found[name], top = offline.dictionary(name, basis)
        except InputError as error:
            raise InputError(f"{name}: {error}", "reducer.basis") from None
        if top > 0:
            limits[name] = GROWTH * top
    return found, limits


def local_terms(
    model: Model, heat: HeatBody, dictionary: Dictionary, left: FloatArray
) -> list[ReducedTerm]:
    """The body's local thermal terms: left (s, n) acts on the whole block's rows."""
    at = model.layout[heat.thermal]
    reduced = []
    for term in heat.local:
        rows, columns = term.rows - at.start, term.columns - at.start
        trial = Trial(dictionary.atoms[columns], dictionary.offset[columns])
        reduced.append(term.compress(trial, np.ascontiguousarray(left[:, rows])))
    return reduced


def refuse_other(model: Model, reducer: str) -> None:
    """Reduced steps take separable mechanics; anything else is refused in words."""
    others: list[Any] = list(model.separated.other)
    if others:
        kinds = sorted({type(t).__name__ for t in others})
        raise InputError(
            f"{reducer} cannot compress the terms {', '.join(kinds)}: no body accounts for them; "
            "use reducer: full", "reducer")
