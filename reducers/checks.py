"""What a reducer can refuse before the training run: pure counting on an assembled model."""

from collections.abc import Iterable, Mapping
from typing import Any, Protocol

from sparsemor.core.errors import Fault
from sparsemor.core.model import Model
from sparsemor.core.protocols import Basis, Preconditioner, Sampler
from sparsemor.core.registry import near
from sparsemor.reducers.choose import chosen

FIELDS = ("elastic", "thermal")


class RowsAndAtoms(Protocol):
    @property
    def rows(self) -> int: ...
    @property
    def atoms(self) -> int | None: ...


def pattern_faults(model: Model, key: str, patterns: Iterable[str]) -> list[Fault]:
    """Patterns that fit no block of any body, whatever fields it has: misspelt ones.

    `*.thermal` is accepted in a scene without heat, so that one reducer serves several scenes.
    """
    owners = {b.owner for b in model.layout if b.field != "multiplier"}
    blocks = sorted(f"{owner}.{field}" for owner in owners for field in FIELDS)
    wild = [f"*.{field}" for field in FIELDS]
    return [Fault(f"{key}.{pattern}", f"fits no block: {near(pattern, [*wild, *blocks], 'blocks')}")
            for pattern in patterns if not any(chosen(b, {pattern: True}, False) for b in blocks)]


def budget_faults(
    model: Model, budgets: Mapping[str, RowsAndAtoms], sampler: Sampler
) -> list[Fault]:
    """Misspelt patterns, blocks without a budget, more rows than a block has to draw from."""
    faults = pattern_faults(model, "budgets", budgets)
    misspelt = bool(faults)
    for name in model.reducible():
        pattern = pattern_of(name, budgets)
        if pattern is None and misspelt:
            continue  # most likely the one that was misspelt
        if pattern is None:
            field = name.rpartition(".")[2]
            faults.append(Fault("budgets", f"no budget fits {name}: give rows and atoms, for "
                                f'instance under "*.{field}"'))
            continue
        size, kept = block_size(model, name), required_rows(model, name, sampler)
        asked = budgets[pattern].rows
        if asked > size - kept:
            besides = f" besides the {kept} that joints and loads need" if kept else ""
            faults.append(Fault(
                f"budgets.{pattern}.rows", f"{asked} rows were asked of {name}, which has "
                f"{size - kept} unknowns to draw from{besides}: take at most {size - kept}"))
    return faults


def preconditioner_faults(
    model: Model, budgets: Mapping[str, RowsAndAtoms], sampler: Sampler,
    preconditioner: Preconditioner, basis: Basis, bases: Mapping[str, Basis],
) -> list[Fault]:
    """Thermal blocks whose preconditioner is not defined for any dictionary they can get."""
    faults = []
    for name in (n for n in model.reducible() if n.endswith(".thermal")):
        pattern = pattern_of(name, budgets)
        if pattern is None:
            continue
        rows = budgets[pattern].rows + required_rows(model, name, sampler)
        atoms = most_atoms(chosen(name, bases, basis), block_size(model, name))
        reason = preconditioner.check(rows, atoms)
        if reason:
            faults.append(Fault("preconditioner", f"{name}: {reason}"))
    return faults


def pattern_of(name: str, table: Mapping[str, Any]) -> str | None:
    """The pattern that decides for a block."""
    return chosen(name, {pattern: pattern for pattern in table}, None)


def block_size(model: Model, name: str) -> int:
    place = model.layout[name]
    return int(place.stop - place.start)


def required_rows(model: Model, name: str, sampler: Sampler) -> int:
    """How many rows a sampler keeps unasked; one that has no such option is handed them all."""
    return len(model.required[name]) if getattr(sampler, "required", True) else 0


def most_atoms(basis: Basis, size: int) -> int:
    """An upper bound of the dictionary's size: `count` where a basis has it, else all unknowns."""
    count = getattr(basis, "count", None)
    return min(count, size) if isinstance(count, int) else size
