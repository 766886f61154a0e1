"""Reducers: methods that solve a time step at full or reduced order, and their public names.

    from sparsemor.reducers import Maps, ProjectionReducer, TestMap

A projection-based reducer derives from `ProjectionReducer` and returns the test maps (left
projections) of each block of unknowns.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sparsemor.reducers.projection.base import Linear as Linear
    from sparsemor.reducers.projection.base import Maps as Maps
    from sparsemor.reducers.projection.base import ProjectionReducer as ProjectionReducer
    from sparsemor.reducers.projection.base import Reducible as Reducible
    from sparsemor.reducers.step.left_inverse import left_inverse as left_inverse
    from sparsemor.reducers.step.operators import TestMap as TestMap

_HOMES = {
    "projection.base": ("Linear", "Maps", "ProjectionReducer", "Reducible"),
    "step.left_inverse": ("left_inverse",),
    "step.operators": ("TestMap",),
}
"""Module -> its public names; modules are imported on first access."""


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"sparsemor.reducers.{module}"), name)
    raise AttributeError(f"module 'sparsemor.reducers' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(n for names in _HOMES.values() for n in names)
