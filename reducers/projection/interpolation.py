"""Interpolation shared by DEIM and GNAT: force or residual modes, and sample points."""

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from sparsemor.core import (
    AssembledModel,
    Basis,
    CentresSnapshots,
    Fault,
    IntArray,
    Note,
    Sampler,
    Slot,
    matched_option,
    slot_default,
)
from sparsemor.reducers.checks import block_size, bound_of_atoms, pattern_faults
from sparsemor.reducers.notes import unsampled_loads
from sparsemor.reducers.projection.base import ProjectionReducer, Reducible
from sparsemor.reducers.projection.force_snapshots import FROM_ZERO

HINT = "take required: true, or more points"


class Interpolating(ProjectionReducer):
    """The options of reducers that see a few rows of each block, the points."""

    snapshot_copies: ClassVar[int] = 6
    """Arrays as large as a block's snapshots that forces are found from, all at once."""

    force_basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Modes of each block's forces in the training run. The published criterion is
    `{use: pod, energy: 0.9999}`."""
    force_bases: dict[str, Annotated[Basis, Slot("basis")]] = {}
    """Other modes of forces by block pattern."""
    oversampling: float = Field(default=2.0, ge=1.0, le=100.0)
    """Points for each mode; above 1 the modes' amounts follow by least squares."""
    points: dict[str, Annotated[int, Field(ge=1)]] = {}
    """Number of points by block pattern, where it shall not follow from `oversampling`."""
    sampler: Annotated[Sampler, Slot("sampler")] = slot_default("deim")
    """Chooses the points; the modes are its vectors."""
    required: bool = False
    """Include the rows of joints and localized loads as points, in addition to the others."""

    def check(self, model: AssembledModel) -> Sequence[Fault]:
        """Faults found by counting, before any training; keys relative to the reducer."""
        faults = [*super().check(model), *pattern_faults(model, "points", self.points),
                  *pattern_faults(model, "force_bases", self.force_bases)]
        for name in model.reducible():
            basis = matched_option(name, self.force_bases, self.force_basis)
            if isinstance(basis, CentresSnapshots) and basis.centred:
                faults.append(Fault("force_basis", f"forces of {name}: {FROM_ZERO}"))
            points, size = matched_option(name, self.points, 0), block_size(model, name)
            modes = self._modes_asked(name, size)
            held = len(model.required[name]) if self.required else 0
            if points > size - held:
                faults.append(Fault("points", f"{points} points were requested of {name}, which "
                                    f"has {size - held} unknowns to choose from"))
            elif points and points + held < min(modes, size):
                faults.append(Fault("points", f"{name}: {points + held} points cannot determine "
                                    f"{modes} modes: take more points or fewer modes"))
        return faults

    def _modes_asked(self, name: str, size: int) -> int:
        """Number of modes that the options set for a block of `size` unknowns; 0 where they do
        not."""
        return bound_of_atoms(matched_option(name, self.force_bases, self.force_basis), size) or 0

    def basis_of_force(self, block: Reducible) -> Basis:
        """The basis of this block's forces."""
        return matched_option(block.name, self.force_bases, self.force_basis)

    def wanted(self, block: Reducible, modes: int) -> int:
        """Number of points, the required ones not counted."""
        return matched_option(block.name, self.points, int(np.ceil(self.oversampling * modes)))

    def notes(self, block: Reducible, points: IntArray) -> tuple[Note, ...]:
        """A sentence for each load or joint that acts on no point."""
        return unsampled_loads(block.model, {block.name: points}, HINT)
