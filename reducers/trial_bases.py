"""Trial bases (dictionaries) of all reducible blocks, and projected local terms."""

from collections.abc import Container
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Dictionary,
    FloatArray,
    InputError,
    Note,
    OfflineProducts,
    ReducedTerm,
    Reducer,
    StepFactors,
    Trial,
    information,
)
from sparsemor.core.linalg.dense import orthonormal, svd
from sparsemor.core.model.fitting_bases import fitted_bases
from sparsemor.core.protocols.separable import HeatBody

DEPENDENT = 1e-7
"""Smallest singular value of a block's atoms relative to the largest one, above which they are
linearly independent: projected matrices square it."""
GROWTH = 1e3
"""Ratio of coefficients to the largest ones of the training run above which a run counts as
divergent."""


class TrialBases(NamedTuple):
    """Dictionary of each block, the largest permitted magnitude of its coefficients (absent where
    it is unknown), and warnings about blocks that the shared basis does not fit."""

    dictionaries: dict[str, Dictionary]
    limits: dict[str, float]
    notes: tuple[Note, ...]


def trial_bases(
    offline: OfflineProducts, model: AssembledModel, reducer: Reducer, step: StepFactors
) -> TrialBases:
    """Trial bases of all reducible blocks; step: step size and integrator constants.

    Raises InputError naming the block whose basis cannot be computed.
    """
    found, limits, fitted = {}, {}, fitted_bases(model, reducer)
    for name, basis in fitted.bases.items():
        try:
            # top: largest coefficient of the snapshots, 0 without any
            found[name], top = offline.dictionary(name, basis, step)
        except InputError as error:
            raise InputError(f"{name}: {error}", "reducer.basis") from None
        if top > 0:
            limits[name] = GROWTH * top
    return TrialBases(found, limits, fitted.notes)


def spanned(
    bases: TrialBases, offline: OfflineProducts, blocks: Container[str] | None = None
) -> TrialBases:
    """Trial bases with orthonormal atoms of the same span where atoms depend on each other, in all
    blocks or in those of `blocks`.

    Where all atoms are used the solution depends on their span alone. Directions with singular
    values below DEPENDENT times the largest are left out. Limits of coefficients grow with the
    change of basis, and a note says so.
    """
    dictionaries, limits, notes = dict(bases.dictionaries), dict(bases.limits), list(bases.notes)
    for name, d in bases.dictionaries.items():
        k = d.atoms.shape[1]
        if k < 2 or orthonormal(d.atoms) or blocks is not None and name not in blocks:
            continue
        made = offline.remember("span", (d.atoms,), partial(_span, d.atoms))
        atoms, scale = np.asarray(made["atoms"], dtype=np.float64), float(made["scale"])
        if not atoms.shape[1]:  # independent atoms stay as they are
            continue
        dictionaries[name] = replace(
            d, atoms=atoms, provenance=tuple(f"span {i}" for i in range(atoms.shape[1])),
            info={**d.info, "span_of": k})
        if name in limits:
            limits[name] *= scale
        notes.append(information(
            f"{name}: the {k} atoms of its basis depend on each other, so that {atoms.shape[1]} "
            "orthonormal ones of the same span are used", "span"))
    return TrialBases(dictionaries, limits, tuple(notes))


def _span(atoms: FloatArray) -> dict[str, FloatArray]:
    """Orthonormal basis of the span of dependent atoms, (n, 0) where they are independent; scale:
    bound of the growth of coefficients in the change of basis."""
    U, s, _ = svd(atoms)
    rank = int(np.count_nonzero(s > DEPENDENT * s[0]))
    kept = U[:, :rank] if rank < atoms.shape[1] else U[:, :0]
    return {"atoms": np.ascontiguousarray(kept),
            "scale": np.array(s[0] * np.sqrt(atoms.shape[1]))}


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
