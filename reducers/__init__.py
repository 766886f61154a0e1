"""Reducers: methods that solve a time step at full or reduced order, and their public names.

    from sparsemor.reducers import Maps, ProjectionReducer, TestMap

A projection-based reducer derives from `ProjectionReducer` and returns the test maps (left
projections) of each block of unknowns; one that evaluates forces at few points derives from
`Interpolating`. The reducers `galerkin`, `deim`, `ecsw`, `lspg` and `gnat` use these names only.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sparsemor.reducers.estimation.error_model_assembly import error_model as error_model
    from sparsemor.reducers.estimation.estimator import ErrorModel as ErrorModel
    from sparsemor.reducers.linalg.left_inverse import left_inverse as left_inverse
    from sparsemor.reducers.linalg.modal_coordinates import (
        modal_coordinates as modal_coordinates,
    )
    from sparsemor.reducers.projection.force_modes import choose_points as choose_points
    from sparsemor.reducers.projection.force_modes import force_modes as force_modes
    from sparsemor.reducers.projection.force_modes import force_snapshots as force_snapshots
    from sparsemor.reducers.projection.force_modes import interpolation as interpolation
    from sparsemor.reducers.projection.interpolation_options import Interpolating as Interpolating
    from sparsemor.reducers.projection.operators_and_test_maps import Approximation as Approximation
    from sparsemor.reducers.projection.operators_and_test_maps import (
        LinearOperators as LinearOperators,
    )
    from sparsemor.reducers.projection.operators_and_test_maps import Maps as Maps
    from sparsemor.reducers.projection.operators_and_test_maps import Reducible as Reducible
    from sparsemor.reducers.projection.projected_error import projection_notes as projection_notes
    from sparsemor.reducers.projection.projection_reducer import Projection as Projection
    from sparsemor.reducers.projection.projection_reducer import (
        ProjectionReducer as ProjectionReducer,
    )
    from sparsemor.reducers.step.projected_operators import TestMap as TestMap

_HOMES = {
    "estimation.error_model_assembly": ("error_model",),
    "estimation.estimator": ("ErrorModel",),
    "projection.projection_reducer": ("Projection", "ProjectionReducer"),
    "projection.operators_and_test_maps": ("Approximation", "LinearOperators", "Maps", "Reducible"),
    "projection.force_modes": (
        "choose_points", "force_modes", "force_snapshots", "interpolation"),
    "projection.projected_error": ("projection_notes",),
    "projection.interpolation_options": ("Interpolating",),
    "linalg.modal_coordinates": ("modal_coordinates",),
    "linalg.left_inverse": ("left_inverse",),
    "step.projected_operators": ("TestMap",),
}
"""Module -> its public names; modules are imported on first access."""


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"sparsemor.reducers.{module}"), name)
    raise AttributeError(f"module 'sparsemor.reducers' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(n for names in _HOMES.values() for n in names)
