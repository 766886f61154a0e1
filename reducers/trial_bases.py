"""Dictionaries of all reducible blocks, and local terms under the maps."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Basis,
    Dictionary,
    FloatArray,
    HeatBody,
    InputError,
    OfflineProducts,
    ReducedTerm,
    StepFactors,
    Trial,
)

GROWTH = 1e3
"""Coefficients this many times beyond the largest of the training run are called divergence."""


def trial_bases(
    offline: OfflineProducts, bases: Mapping[str, Basis], step: StepFactors | None = None
) -> tuple[dict[str, Dictionary], dict[str, float]]:
    """One dictionary a block, and the largest coefficient that is still sane; step: the steps that
    they are to serve.

    InputError names the block whose basis cannot be built.
    """
    found, limits = {}, {}
    for name, basis in bases.items():
        try:
            found[name], top = offline.dictionary(name, basis, step)
        except InputError as error:
            raise InputError(f"{name}: {error}", "reducer.basis") from None
        if top > 0:
            limits[name] = GROWTH * top
    return found, limits


def local_terms(
    model: AssembledModel, heat: HeatBody, dictionary: Dictionary, left: FloatArray
) -> list[ReducedTerm]:
    """The body's local thermal terms: left (s, n) acts on the whole block's rows."""
    at = model.layout[heat.thermal]
    reduced = []
    for term in heat.local:
        rows, columns = term.rows - at.start, term.columns - at.start
        trial = Trial(dictionary.atoms[columns], dictionary.offset[columns])
        reduced.append(term.compress(trial, np.ascontiguousarray(left[:, rows])))
    return reduced
