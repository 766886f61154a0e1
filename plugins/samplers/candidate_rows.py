"""Base classes of samplers: candidate rows, as single rows or as whole nodes; options for rows that
are always kept; and samplers that compare rows of the atoms, because sampled equations must
distinguish these."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from sparsemor.core import (
    BlockData,
    BoolArray,
    Dictionary,
    FloatArray,
    InputError,
    IntArray,
    RowsKept,
    Sampler,
)
from sparsemor.plugins.samplers.smallest_singular_pair import EPS

Unit = Literal["dof", "node"]
Required = bool | Literal["ring"]
"""Rows that are always kept. False: none; True: those that joints and localized loads act on;
`ring`: also those of elements along the path of moving loads."""
Draw = Callable[[int, int, np.random.Generator], IntArray]
"""Function of (N, m, rng) that returns m distinct integers below N."""


def kept_rows(option: Required, block: BlockData, required: IntArray) -> IntArray:
    """Rows that a sampler with this option always keeps, sorted; required: rows that joints and
    localized loads act on."""
    if option == "ring":
        return np.union1d(required, block.ring)
    return required if option else required[:0]


def free_rows(n: int, m: int, required: IntArray, name: str) -> BoolArray:
    """Mask (n,), True for the rows that are not required. Raises InputError when m exceeds their
    number; name: of the block."""
    free = ~np.isin(np.arange(n), required)
    left = int(free.sum())
    if not 0 <= m <= left:
        more = f" in addition to the {n - left} required ones" if left < n else ""
        raise InputError(
            f"{m} rows were requested of {name}, which has {left} unknowns to draw from"
            f"{more}: take between 0 and {left}",
            "rows",
        )
    return free


def sample_rows(
    draw: Draw, block: BlockData, m: int, kept: IntArray, unit: Unit, rng: np.random.Generator
) -> IntArray:
    """Sorted rows: those in `kept` and m more, selected by `draw`."""
    free = free_rows(block.size, m, kept, block.name)
    candidates = np.flatnonzero(free)
    if unit == "dof":
        chosen = candidates[draw(candidates.size, m, rng)]
    else:
        chosen = candidates[_whole_nodes(draw, block.coordinates[candidates], m, rng)]
    return np.union1d(np.flatnonzero(~free), chosen)


def _whole_nodes(
    draw: Draw, coordinates: FloatArray, m: int, rng: np.random.Generator
) -> IntArray:
    """Positions of m rows on as few nodes as possible: fewer elements are evaluated than by single
    rows.

    coordinates (number of candidate rows, d): position of each row's node, m; draw(N, m, rng): m
    distinct integers below N. Only the last node drawn may contribute fewer rows than it has.
    """
    node = node_numbers(coordinates)
    sizes = np.bincount(node)  # number of candidate rows of each node
    nodes = draw(sizes.size, -(-m // int(sizes.max(initial=1))), rng)
    order = np.concatenate([nodes, rng.permutation(np.setdiff1d(np.arange(sizes.size), nodes))])
    return in_order(node, order, m)


def node_numbers(coordinates: FloatArray) -> IntArray:
    """Node number of each row, in the order of first occurrence, so that strata of nodes follow the
    rows."""
    _, first, node = np.unique(coordinates, axis=0, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[node.reshape(-1)]


def in_order(node: IntArray, order: IntArray, m: int) -> IntArray:
    """Positions of m rows in `node`, the node number of each row: whole nodes in the given order,
    the last one perhaps in part."""
    rank = np.empty(order.size, dtype=np.int64)
    rank[order] = np.arange(order.size)
    return np.argsort(rank[node], kind="stable")[:m]


@dataclass(slots=True, eq=False)
class GreedyRows:
    """Greedy selection of the rows of one block by scores, which may change after each selection.

    taken (n,): mask of the rows selected so far, initially the required ones; node (n,): rows with
    the same number are taken together; left: number of rows still to be taken.
    """

    taken: BoolArray
    node: IntArray
    left: int

    @classmethod
    def from_coordinates(
        cls, coordinates: FloatArray, free: BoolArray, m: int, unit: Unit
    ) -> "GreedyRows":
        node = np.arange(free.size) if unit == "dof" else node_numbers(coordinates)
        return cls(~free, node, m)

    def take(self, score: FloatArray) -> IntArray:
        """Takes the free row with the largest score (n,), with the others of its node while rows
        are left; returns their numbers."""
        open_score = np.where(self.taken, -np.inf, score)
        node = self.node[open_score.argmax()]
        mates = np.flatnonzero((self.node == node) & ~self.taken)
        best = mates[np.argsort(-open_score[mates], kind="stable")][: self.left]
        self.taken[best] = True
        self.left -= best.size
        return best

    def take_in_order(self, key: FloatArray) -> None:
        """Takes all rows that are left, whole nodes by increasing key (number of nodes,)."""
        free = np.flatnonzero(~self.taken)
        order = np.argsort(key, kind="stable")
        self.taken[free[in_order(self.node[free], order, self.left)]] = True
        self.left = 0

    def numbers(self) -> IntArray:
        """Rows taken so far, sorted."""
        return np.flatnonzero(self.taken)


class RowSampler(Sampler):
    """Base class of samplers, which select the rows (equations) of a block that a reduced model
    evaluates; a subclass defines `rows_beside`."""

    required: Required = True
    """True: keep the rows that joints and localized loads act on (`ring`: also those of all
    elements along the path of moving loads), and choose the others to complement them. False, with
    `lhs` the published variant: these rows are sampled like all others, and a run without one of
    them may be unstable."""
    unit: Unit = "dof"
    """`dof` selects single rows; `node` selects the rows of a node together."""

    @property
    def keeps(self) -> RowsKept:
        """Rows that a sample contains in addition to those drawn: of joints and localized loads
        (`required`), also of elements along the path of moving loads (`ring`), or `none`."""
        return "ring" if self.required == "ring" else "required" if self.required else "none"

    @property
    def whole_nodes(self) -> bool:
        return self.unit == "node"

    def sample(
        self,
        block: BlockData,
        m: int,
        dictionary: Dictionary,
        rng: np.random.Generator,
        required: IntArray,
    ) -> IntArray:
        """Sorted distinct rows: those always kept and m more. required: rows on which joints and
        localized loads act. Raises InputError when there are fewer."""
        return self.rows_beside(kept_rows(self.required, block, required), block, m, dictionary,
                                rng)

    @abstractmethod
    def rows_beside(
        self, kept: IntArray, block: BlockData, m: int, dictionary: Dictionary,
        rng: np.random.Generator,
    ) -> IntArray:
        """Sorted rows: those in `kept` and m more."""


Of = Literal["operator", "atoms"]


class SpanSampler(RowSampler):
    """Base class of samplers that use the values of the atoms; a subclass defines `choose`."""

    of: Of = "operator"
    """Vectors whose rows are compared: `operator`: D times the atoms, with the operator D of a time
    step; `atoms`: the atoms themselves."""
    leading: int | None = Field(default=None, ge=1)
    """Number of leading atoms whose rows are compared; left out: all. All rows of a complete
    orthonormal basis have the same norm, so that none is better than another: there the atoms that
    carry the snapshots decide."""
    step: float | None = Field(default=None, gt=0.0)
    """Step size h in the operator D, s: stiffness + mass / h^2 for displacements, conductivity +
    capacity / h for temperatures. Left out: the operator of the scene's own step and integrator. A
    tenth or ten times the true one serves nearly as well."""

    def rows_beside(
        self, kept: IntArray, block: BlockData, m: int, dictionary: Dictionary,
        rng: np.random.Generator,
    ) -> IntArray:
        free = free_rows(block.size, m, kept, block.name)
        rows = GreedyRows.from_coordinates(block.coordinates, free, m, self.unit)
        self.choose(orthonormal(self._vectors(block, dictionary), block.name), rows, rng)
        return rows.numbers()

    @abstractmethod
    def choose(self, U: FloatArray, rows: GreedyRows, rng: np.random.Generator) -> None:
        """Takes rows until none is `left` to be taken. U (n, k): orthonormal columns."""

    def _vectors(self, block: BlockData, dictionary: Dictionary) -> FloatArray:
        """Vectors (n, k) whose rows are compared; columns that are only round-off are set to
        zero."""
        T = dictionary.atoms[:, : self.leading]
        if self.of == "atoms":
            return T
        D = block.operator
        if self.step is not None:
            # displacements have components, temperatures have none: that decides the order in time;
            # mass: of temperatures the capacity
            h = self.step**2 if block.component.any() else self.step
            D = block.stiffness + block.mass / h
        V = np.asarray(D @ T)
        largest = float(abs(D).sum(axis=1).max(initial=0.0)) * np.linalg.norm(T, axis=0)
        return np.where(np.linalg.norm(V, axis=0) > EPS * largest, V, 0.0)


def orthonormal(V: FloatArray, name: str) -> FloatArray:
    """Orthonormal basis Q (n, r): its first columns span the first independent columns of V (n, k).

    The order of the atoms is kept, and columns that depend on earlier ones are left out. Raises
    InputError when V is zero.
    """
    norms = np.linalg.norm(V, axis=0)
    V = V[:, norms > 0.0] / norms[norms > 0.0]
    if V.shape[1] == 0:
        raise InputError(f"all atoms of {name} vanish under its operator, so that no row is better "
                         "than another: use sampler: lhs", "sampler")
    Q, R = np.linalg.qr(V)
    fresh = np.zeros(V.shape[1], dtype=bool)
    fresh[: R.shape[0]] = np.abs(np.diag(R)) > max(V.shape) * EPS
    # a dependent column leaves a column of noise in Q, which later ones would be cleared of
    return np.asarray(Q if fresh.all() else np.linalg.qr(V[:, fresh])[0])
