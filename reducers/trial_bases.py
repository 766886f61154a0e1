"""Trial bases (dictionaries) of all reducible blocks, and projected local terms."""

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
"""Ratio of coefficients to the largest ones of the training run above which a run counts as
divergent."""


def trial_bases(
    offline: OfflineProducts, bases: Mapping[str, Basis], step: StepFactors | None = None
) -> tuple[dict[str, Dictionary], dict[str, float]]:
    """Dictionary of each block, and the largest permitted magnitude of its coefficients; step: step
    size and integrator constants, for bases that depend on these.

    Raises InputError naming the block whose basis cannot be computed.
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
    """Local thermal terms of a body (such as radiation) on its trial basis; left (s, n): test map
    of all rows of the block."""
    at = model.layout[heat.thermal]
    reduced = []
    for term in heat.local:
        rows, columns = term.rows - at.start, term.columns - at.start
        trial = Trial(dictionary.atoms[columns], dictionary.offset[columns])
        reduced.append(term.compress(trial, np.ascontiguousarray(left[:, rows])))
    return reduced
