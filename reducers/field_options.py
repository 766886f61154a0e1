"""Reducer options by field (elastic, thermal): lookup by block pattern, and numbers of atoms."""

from collections.abc import Mapping
from typing import TypeVar

from sparsemor.core import Basis

T = TypeVar("T")
BASES = ("basis", "bases")
"""Options that set the trial bases of the blocks."""


def counts_atoms(basis: Basis) -> bool:
    """True if the number of atoms is an option of the basis, `count`."""
    return "count" in type(basis).model_fields


def of_field(field: str, table: Mapping[str, T]) -> T | None:
    """Entry for a field in a table by block pattern: that of `*.field`, otherwise the first entry
    whose pattern names the field or is `*`; None if there is none."""
    if f"*.{field}" in table:
        return table[f"*.{field}"]
    return next((v for p, v in table.items() if p == "*" or p.rpartition(".")[2] == field), None)


def counted(
    atoms: Mapping[str, int], basis: Basis, bases: Mapping[str, Basis]
) -> tuple[Basis, dict[str, Basis]]:
    """The shared basis and the bases by pattern, with the numbers of atoms in `atoms` (field ->
    number) where the number is an option of the basis; the shared basis gets the number of the
    first field."""
    found = dict(bases)
    for i, (field, count) in enumerate(atoms.items()):
        if i > 0:
            own = bases.get(f"*.{field}", basis)
            if counts_atoms(own):
                found[f"*.{field}"] = own.model_copy(update={"count": count})
    first = next(iter(atoms.values()), None)
    if first is None or not counts_atoms(basis):
        return basis, found
    return basis.model_copy(update={"count": first}), found
