"""Trial bases of the blocks of a reducer, with others where its shared basis does not fit."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from sparsemor.core.model.block_patterns import matched_option
from sparsemor.core.notes import Note
from sparsemor.core.protocols.basis import Basis
from sparsemor.core.protocols.reducer import AssembledModel, Reducer
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.default_plugins import BASIS


@dataclass(frozen=True, slots=True)
class FittedBases:
    """Basis of each block, and warnings about blocks that do without the shared basis."""

    bases: Mapping[str, Basis]
    notes: tuple[Note, ...] = ()


def fitted_bases(model: AssembledModel, reducer: Reducer) -> FittedBases:
    """Bases of all reducible blocks of a model; none for a reducer of full order.

    A block that a pattern in `bases` names has that basis. The others have the shared `basis`, or,
    where it cannot be built (no joint acts on temperatures, no load moves over a body), what is
    left of it (`Basis.fitting`), or the default basis. A shared basis that fits no block of the
    model stays, and is refused when it is built. They are chosen once for a model and a reducer.
    """
    # kept with the reducer, so that no other one gets its number
    return model.once(("fitted bases", id(reducer)), partial(_fitted, model, reducer))[0]


def _fitted(model: AssembledModel, reducer: Reducer) -> tuple[FittedBases, Reducer]:
    """Bases of the blocks, as `fitted_bases` describes, and the reducer, which they keep alive."""
    chosen, found = reducer.trial_bases(), dict[str, Basis]()
    if chosen is None:
        return FittedBases(found), reducer
    shared = chosen.shared
    default: Any = None
    lacking, partly = dict[str, str](), dict[str, str]()
    for name in model.reducible():
        found[name] = matched_option(name, chosen.others, shared)
        why = shared.unfit(model.block_data(name)) if found[name] is shared else ""
        if why:
            default = default or Registry().get("basis", BASIS)()
            rest = shared.fitting(model.block_data(name))
            if rest is not None:
                found[name], partly[name] = rest, why
            elif not isinstance(shared, type(default)):  # not the default by itself
                lacking[name] = why
    # a shared basis that fits no block at all is refused later, with its own reason
    if lacking and all(
            n in lacking or shared.unfit(model.block_data(n)) for n in model.reducible()):
        return FittedBases(found), reducer
    found |= dict.fromkeys(lacking, default)
    texts = [*(f"reducer.basis does not fit {name}, which takes the default basis {BASIS}: {why}"
               for name, why in lacking.items()),
             *(f"reducer.basis: {name} does without one of its bases: {why}"
               for name, why in partly.items())]
    return FittedBases(found, tuple(Note(text, "basis_by_field") for text in texts)), reducer
