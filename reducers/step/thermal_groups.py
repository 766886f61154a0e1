"""Reduced thermal blocks that are coupled by conduction between bodies, solved together.

With B_i = c1 C_i + K_i of each block and the couplings A_ij T_j + B_ij T_j', the rows of the group
are one linear system for all its temperatures,

    B_i d_i + sum_j (A_ij + c1 B_ij) d_j
        = q_i(t) - C_i T_i' - K_i T_i - sum_j (A_ij T_j + B_ij T_j') - local terms,

with increments d from the predictions T, T'.

The rows are multiplied by the left inverse of B_i; the small dense matrix is inverted once.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Dictionary,
    FloatArray,
    ReducedTerm,
    SolveFailed,
    Status,
)
from sparsemor.core.protocols.separable import HeatBody, HeatCoupling
from sparsemor.core.protocols.term import PointArrays
from sparsemor.reducers.linalg.modal_coordinates import compact, dense
from sparsemor.reducers.step.thermal_block import CompressedHeat
from sparsemor.reducers.step.time_tables import sum_of


def group_name(members: Sequence[HeatBody]) -> str:
    """Name of a group: the joined names of its blocks."""
    return "+".join(b.thermal for b in members)


def starts_of(sizes: Sequence[int]) -> list[slice]:
    """Index ranges of consecutive blocks of these sizes."""
    edges = np.cumsum([0, *sizes]).tolist()
    return [slice(a, b) for a, b in zip(edges, edges[1:], strict=False)]


def couplings_of(model: AssembledModel, names: Mapping[str, int]) -> list[HeatCoupling]:
    """Couplings between the blocks of a group; names: block -> number in the group."""
    return [c for c in model.separated.couplings if c.rows in names]


@dataclass(frozen=True, slots=True, eq=False)
class GroupLocal(ReducedTerm):
    """A projected local term of one member of the group: `at` range of its unknowns in the group;
    left (K, s): map of its s rows to all K rows of the group."""

    term: ReducedTerm
    at: slice
    left: FloatArray

    @property
    def elements(self) -> int:
        return self.term.elements

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        at = self.at
        return np.asarray(self.left @ self.term.residual(x[at], v[at], a[at], t))

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        return self.linearized(x, v, a, t, c1, c2)[1]

    def linearized(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Residual and Jacobian from one evaluation of the term."""
        at, J = self.at, np.zeros((len(self.left), len(x)))
        r, slope = self.term.linearized(x[at], v[at], a[at], t, c1[at], c2[at])
        J[:, at] = self.left @ slope
        return np.asarray(self.left @ r), J

    def arrays(self) -> PointArrays | None:
        """The term as arrays, None where the projected one has none."""
        made = self.term.arrays()
        return None if made is None else made.through(self.left).placed(self.at, len(self.left))


def compressed_group(
    model: AssembledModel, members: Sequence[HeatBody], blocks: Sequence[CompressedHeat],
    dictionaries: Mapping[str, Dictionary], force_maps: Mapping[str, FloatArray], c1: float,
) -> CompressedHeat:
    """Reduced thermal block of the group, all atoms active. members, blocks: each alone;
    force_maps: block -> (k, n), left inverse of its operator times the test map of forces. Raises
    SolveFailed where the coupled matrix is singular.

    Rows of the group, times the left inverse of each block's operator, for increments d from the
    predictions T, T' (`by_rate`, `by_value`, `loads` those of the single blocks):

        J d = (by_rate - B) T' + (by_value - A) T + loads(t) - fixed - local terms,
        J = 1 + A + c1 B,

    A, B (K, K): couplings A T + B T' of all K atoms, on the left-hand side; fixed (K,): A times the
    offsets of the dictionaries. The result has these rows times J^-1. `compact` stores a diagonal
    matrix as its diagonal, `dense` makes it a matrix again. Tolerances are equal in all blocks.
    """
    names = {b.thermal: i for i, b in enumerate(members)}
    at = starts_of([b.by_rate.shape[0] for b in blocks])  # range of each block in the group
    size = at[-1].stop
    A, B, fixed = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    by_rate, by_value = np.zeros((size, size)), np.zeros((size, size))
    for here, block in zip(at, blocks, strict=True):
        by_rate[here, here], by_value[here, here] = dense(block.by_rate), dense(block.by_value)
    for c in couplings_of(model, names):
        i, j, d = at[names[c.rows]], at[names[c.columns]], dictionaries[c.columns]
        left = force_maps[c.rows]
        A[i, j] += left @ np.asarray(c.A @ d.atoms)
        B[i, j] += left @ np.asarray(c.B @ d.atoms)
        fixed[i] += left @ (c.A @ d.offset)
    J = np.eye(size) + A + c1 * B
    try:
        inverse: FloatArray = np.asarray(np.linalg.inv(J), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise SolveFailed(
            Status.SINGULAR, 0.0, group_name(members), "heat of coupled bodies") from None

    loads = sum_of([b.loads.less(fixed[here]).through(inverse[:, here])
                    for b, here in zip(blocks, at, strict=True)])
    times = np.unique(np.concatenate([np.zeros(0), *(
        np.array(b.prescribed.times) for b in blocks if b.prescribed.rows is not None)]))
    local = tuple(GroupLocal(t, here, inverse[:, here])
                  for b, here in zip(blocks, at, strict=True) for t in b.local)
    return CompressedHeat(
        by_rate=compact(inverse @ (by_rate - B)), by_value=compact(inverse @ (by_value - A)),
        prescribed=loads.table(times), active=None, local=local, c1=c1, loads=loads,
        tolerances=blocks[0].tolerances)


def heat_groups(
    model: AssembledModel, blocks: Mapping[str, CompressedHeat],
    dictionaries: Mapping[str, Dictionary], force_maps: Mapping[str, FloatArray], c1: float,
) -> dict[str, CompressedHeat]:
    """Group name -> reduced thermal block; blocks that are coupled by conduction form one group,
    solved together. A block without coupling may be absent from `blocks`, and is then left out.
    force_maps, c1: as in `compressed_group`."""
    found = {}
    for members in model.separated.heat_groups:
        if len(members) > 1:
            found[group_name(members)] = compressed_group(
                model, members, [blocks[b.thermal] for b in members], dictionaries, force_maps, c1)
        elif members[0].thermal in blocks:
            found[group_name(members)] = blocks[members[0].thermal]
    return found
