"""Options and checks shared by DEIM and GNAT: modes of forces or residuals, and interpolation
points."""

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from sparsemor.core import (
    AssembledModel,
    Basis,
    Fault,
    FloatArray,
    IntArray,
    Note,
    Sampler,
    Slot,
    SolveFailed,
    StepFactors,
    slot_default,
)
from sparsemor.core.model.block_patterns import matched_option, unmatched_patterns
from sparsemor.core.model.expected_states import expected_states
from sparsemor.reducers.block_counts import block_size
from sparsemor.reducers.projection.force_modes import FROM_ZERO
from sparsemor.reducers.projection.operators_and_test_maps import Reducible
from sparsemor.reducers.projection.projection_reducer import ProjectionReducer
from sparsemor.reducers.reducer_notes import unsampled_loads

SAMPLED = "sampled_rows"
"""Kind of the note on loads that are not interpolated."""
LIMIT = 0.01
"""Largest relative error of the response to interpolated loads without a note."""
HINT = "take required: true, or more points"


class Interpolating(ProjectionReducer):
    """Base class of reducers that evaluate a few rows of each block, the interpolation points."""

    snapshot_copies: ClassVar[int] = 6
    """Arrays of the size of a block's snapshots that are in memory at once while forces are
    computed."""

    force_basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Modes of each block's forces in the training run. The published criterion is
    `{use: pod, energy: 0.9999}`."""
    force_bases: dict[str, Annotated[Basis, Slot("basis")]] = {}
    """Other bases of the forces by block pattern."""
    oversampling: float = Field(default=2.0, ge=1.0, le=100.0)
    """Number of points per mode; above 1 the coefficients of the modes follow by least squares."""
    points: dict[str, Annotated[int, Field(ge=1)]] = {}
    """Number of points by block pattern, instead of the number that follows from
    `oversampling`."""
    sampler: Annotated[Sampler, Slot("sampler")] = slot_default("deim")
    """Method that chooses the points from the modes."""
    required: bool = False
    """Include the rows of joints and localized loads as points, in addition to the others."""

    def check(self, model: AssembledModel) -> Sequence[Fault]:
        """Faults of the options found by counting, before any training; keys relative to the
        reducer."""
        layout = model.layout
        faults = [*super().check(model), *unmatched_patterns(layout, "points", self.points),
                  *unmatched_patterns(layout, "force_bases", self.force_bases)]
        for name in model.reducible():
            basis = matched_option(name, self.force_bases, self.force_basis)
            if basis.has_offset:
                faults.append(Fault("force_basis", f"forces of {name}: {FROM_ZERO}"))
            points, size = matched_option(name, self.points, 0), block_size(model, name)
            modes = basis.most_atoms(size) or 0  # 0 where the options set no number
            # rows of joints and localized loads, which are points in addition
            fixed = len(model.required[name]) if self.required else 0
            if points > size - fixed:
                faults.append(Fault("points", f"{points} points were requested of {name}, which "
                                    f"has {size - fixed} unknowns to choose from"))
            elif points and points + fixed < min(modes, size):
                faults.append(Fault("points", f"{name}: {points + fixed} points cannot determine "
                                    f"{modes} modes: take more points or fewer modes"))
        return faults

    def force_bases_used(self) -> Sequence[Basis]:
        return self.force_basis, *self.force_bases.values()

    def basis_of_force(self, block: Reducible) -> Basis:
        """The basis (POD by default) of this block's forces."""
        return matched_option(block.name, self.force_bases, self.force_basis)

    def wanted(self, block: Reducible, modes: int) -> int:
        """Number of points for so many modes, without the required ones."""
        return matched_option(block.name, self.points, int(np.ceil(self.oversampling * modes)))

    def notes(
        self, block: Reducible, points: IntArray, U: FloatArray, reconstruction: FloatArray
    ) -> tuple[Note, ...]:
        """A note for each load or joint that acts on none of the points, and one if the loads of
        the run are not interpolated from them; U (n, f): modes, reconstruction (f, m): their
        coefficients from values at the points."""
        return (*unsampled_loads(block.model, {block.name: points}, HINT),
                *_interpolated_loads(block, points, U, reconstruction))


def _interpolated_loads(
    block: Reducible, points: IntArray, U: FloatArray, reconstruction: FloatArray
) -> tuple[Note, ...]:
    """Note on loads f (n, M) of the run that modes U (n, q) of the training do not contain:
    displacements (or temperatures) A c of a step, (A^T D A) c = A^T f with the atoms A and the
    operator D, under the error f - U reconstruction f[points], relative to those under f."""
    recording, separated = block.offline.recording, block.model.separated
    tables = [*(h.tables for h in separated.heat),
              *(m.operators.tables for m in separated.moving if m.operators is not None)]
    if recording is None or any(tables):  # loads that move: no estimate
        return ()
    step = StepFactors(block.h, 0.0, 0.0, 0.0)  # of which the estimate reads h alone
    try:
        f = expected_states(block.model, block.name, step, max(recording.end, block.h)).forces
    except SolveFailed:  # the run itself will say so
        return ()
    A = block.dictionary.atoms
    both = np.concatenate([f - U @ (reconstruction @ f[points]), f], axis=1)  # error | loads
    c = np.linalg.lstsq(A.T @ (block.linear.operator @ A), A.T @ both, rcond=None)[0]
    error, change = (float(np.linalg.norm(A @ part, axis=0).max(initial=0.0))
                     for part in np.split(c, 2, axis=1))
    if not error > LIMIT * change:
        return ()
    return (Note(
        f"the loads of this run on {block.name} are not those of its training: interpolated from "
        f"{len(points)} points they cause an error of {error / change:.2g} of their response "
        f"(limit {LIMIT:g}): train on loads that cover the run (training.overrides), or take a "
        "reducer that needs no force modes (galerkin)", SAMPLED),)
