"""Reducers: how one time step is solved, and their public names for plugins.

    from sparsemor.reducers import Maps, ProjectionReducer, TestMap

A reducer that projects derives from `ProjectionReducer` and gives each block its test maps.
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
"""Module -> its public names, imported when they are asked for."""


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"sparsemor.reducers.{module}"), name)
    raise AttributeError(f"module 'sparsemor.reducers' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(n for names in _HOMES.values() for n in names)
