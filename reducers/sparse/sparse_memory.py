"""State between steps of a reduced model with atom selection."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self, TypeAlias, TypeVar

from sparsemor.reducers.sparse.supported_equations import ActiveRows
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from sparsemor.reducers.step.step_memory import Memory
from sparsemor.reducers.step.thermal_block import CompressedHeat

KEPT = 64
"""Number of supports (sets of active atoms) whose reduced operators are kept: supports often
recur."""
Supports: TypeAlias = tuple[int, str, bytes]
"""Key of reduced operators: number of the set of rows, block ("" for all together), and its
support."""
K = TypeVar("K")
T = TypeVar("T")


@dataclass(eq=False, kw_only=True)
class SparseMemory(Memory):
    """State between steps with atom selection: adds the current step solver and, by set of rows,
    block and support, the reduced operators (heat, elastic) and step solvers of recent supports.
    These are rebuilt after a restart. step: number of steps so far."""

    step: int = 0
    heat: dict[Supports, CompressedHeat] = field(default_factory=dict)
    elastic: dict[Supports, ActiveRows] = field(default_factory=dict)
    steppers: dict[Supports, BlockwiseSolver] = field(default_factory=dict)
    current: BlockwiseSolver | None = None

    def __getstate__(self) -> dict[str, object]:
        return {**super().__getstate__(), "heat": {}, "elastic": {}, "steppers": {},
                "current": None}

    def copy(self) -> Self:
        """Independent copy of the state. Reduced operators of supports are immutable and shared."""
        return replace(super().copy(), heat=dict(self.heat), elastic=dict(self.elastic),
                       steppers=dict(self.steppers))

    def rows_changed(self, fresh: bool) -> None:
        """Drops reduced operators of the previous set of rows if that is not used again
        (`fresh`). linearised_on: active unknowns (n,) of the kept Jacobian, None: none is kept."""
        self.current = None
        self.linearised_on = None
        if fresh:
            self.heat, self.elastic, self.steppers = {}, {}, {}

    def counted_part(self, kept: dict[Supports, T], key: Supports, make: Callable[[], T]) -> T:
        """`get_or_create` for the reduced operators of one support; a computed entry counts as a
        factorization."""
        def made() -> T:
            self.factorizations += 1
            return make()

        return get_or_create(kept, key, made)


def get_or_create(kept: dict[K, T], key: K, make: Callable[[], T]) -> T:
    """Entry of a key, computed if missing; the oldest of `KEPT` entries is dropped."""
    if key not in kept:
        if len(kept) >= KEPT:
            kept.pop(next(iter(kept)))
        kept[key] = make()
    return kept[key]
