"""What acts between bodies inside the step and can tell its resultants, such as a contact.

A term has them where it offers `histories`, names of resultants, none where it does not evaluate
enough of itself to know them, and `resultants(x, v, t)` -> name -> number, at its own columns.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sparsemor.core.arrays import IntArray
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols import State


@dataclass(frozen=True, slots=True, eq=False)
class Acting:
    """A term with resultants, its name in the scene, and its columns (k,) among the unknowns."""

    name: str
    columns: IntArray
    term: Any


def acting(terms: Iterable[tuple[Any, IntArray]]) -> tuple[Acting, ...]:
    """Those of the terms, each with its columns, that know their resultants."""
    return tuple(Acting(str(term.source), columns, term) for term, columns in terms
                 if getattr(term, "histories", ()))


def untold(terms: Iterable[Any]) -> tuple[Note, ...]:
    """A sentence for each reduced term that leaves out what its resultants depend on."""
    whole = ((t, getattr(t, "term", None)) for t in terms)
    return tuple(information(
        f"contact {t.source}: this model evaluates a part of the facets, so the resultants of the "
        "contact are not known, and no history of it is kept", "resultants")
                 for t, inner in whole if hasattr(inner, "resultants") and not t.histories)


def acting_of(solver: Any, memory: Any) -> tuple[Acting, ...]:
    """Of a step solver, after the step that left `memory` (None: only their names count); nothing
    where it does not say."""
    told = getattr(solver, "acting", None)
    return () if told is None else tuple(told(memory))


def resultants(known: Sequence[Acting], state: State) -> Mapping[str, float]:
    """`name.history` -> value at a state."""
    return {f"{a.name}.{what}": value for a in known
            for what, value in a.term.resultants(state.x[a.columns], state.v[a.columns], state.t)
            .items()}
