"""Reducer options by field (elastic, thermal): lookup by block pattern, and numbers of atoms."""

from collections.abc import Mapping
from typing import Protocol, TypeVar, runtime_checkable

from sparsemor.core import Basis, Plugin

T = TypeVar("T")
BASES = ("basis", "bases")
"""Options that set the trial bases of the blocks."""


@runtime_checkable
class CountsAtoms(Basis, Protocol):
    """A basis whose number of atoms is an option `count`; None: not set."""

    @property
    def count(self) -> int | None: ...


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
            if isinstance(own, CountsAtoms):
                found[f"*.{field}"] = _with_count(own, count)
    first = next(iter(atoms.values()), None)
    if first is None or not isinstance(basis, CountsAtoms):
        return basis, found
    return _with_count(basis, first), found


def _with_count(basis: Basis, count: int) -> Basis:
    return basis.model_copy(update={"count": count}) if isinstance(basis, Plugin) else basis
