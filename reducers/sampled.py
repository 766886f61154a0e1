"""One block of the sparse method: its sampled rows, weights and budget, prepared by support."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack, solve_triangular

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.model import Model
from sparsemor.core.offline import Offline
from sparsemor.core.protocols import Dictionary, Preconditioner, Sampler
from sparsemor.core.separable import HeatBody
from sparsemor.reducers.elastic import CompressedElastic
from sparsemor.reducers.heat import CompressedHeat
from sparsemor.reducers.represent import local_terms
from sparsemor.reducers.test_map import TestedElastic, TestedHeat

RANK_RTOL = 1e-13
"""Reciprocal condition of the unit columns below which the rows cannot tell atoms apart."""


class RankDeficient(RuntimeError):
    """The sampled rows cannot tell the active atoms of `block` apart."""

    def __init__(self, block: str, detail: str) -> None:
        super().__init__(f"{block}: {detail}")
        self.block, self.detail = block, detail


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """A block under sampled rows. B (m, k) = rows of D or c1 C + K times the atoms.

    weight (m, m) or None: the preconditioner P; budget: most atoms active at once.
    """

    name: str
    dictionary: Dictionary
    rows: IntArray
    budget: int
    B: FloatArray
    weight: FloatArray | None

    @property
    def atoms(self) -> int:
        return int(self.B.shape[1])

    @property
    def selects(self) -> bool:
        return self.budget < self.atoms

    def left(self, support: IntArray | None) -> FloatArray:
        """(s, m): least squares on the support, left @ B_S = 1. Raises RankDeficient."""
        A = self.B if self.weight is None else self.weight @ self.B
        A = A if support is None else A[:, support]
        if A.shape[1] > A.shape[0]:
            raise RankDeficient(self.name, f"{A.shape[1]} active atoms, {A.shape[0]} rows")
        norms = np.linalg.norm(A, axis=0)
        if not norms.all():
            raise RankDeficient(self.name, f"{int((norms == 0).sum())} atoms vanish on the rows")
        Q, R = np.linalg.qr(A / norms)
        rcond = float(lapack.dtrcon(R)[0])
        if not rcond > RANK_RTOL:
            raise RankDeficient(self.name, f"reciprocal condition {rcond:.1e}")
        left = solve_triangular(R, Q.T) / norms[:, None]
        return np.asarray(left if self.weight is None else left @ self.weight)


@dataclass(frozen=True, slots=True, eq=False)
class SampledElastic:
    block: Sampled
    tested: TestedElastic

    def prepared(self, support: IntArray | None) -> CompressedElastic:
        return CompressedElastic.of(self.tested, self.block.left(support), support)


@dataclass(frozen=True, slots=True, eq=False)
class SampledHeat:
    block: Sampled
    tested: TestedHeat
    model: Model
    body: HeatBody
    c1: float

    def prepared(self, support: IntArray | None) -> CompressedHeat:
        left = self.block.left(support)
        local = []
        if self.body.local:
            wide = np.zeros((len(left), self.block.dictionary.atoms.shape[0]))
            wide[:, self.block.rows] = left
            local = local_terms(self.model, self.body, self.block.dictionary, wide)
        return CompressedHeat.of(self.tested, left, support, self.c1, local)


def choose_rows(
    model: Model, offline: Offline, name: str, rows: int, budget: int, sampler: Sampler,
    dictionary: Dictionary, rng: np.random.Generator,
) -> IntArray:
    """The sampler's rows (cached); rng is the block's own, so that a hit changes no other block."""
    required = model.required[name]

    def make() -> dict[str, IntArray]:
        data = model.block_data(name)
        return {"rows": sampler.sample(data, rows, dictionary, rng, required)}

    drawn = repr(rng.bit_generator.state)
    depends = (name, rows, sampler, dictionary.atoms, required, drawn)
    chosen: IntArray = np.asarray(offline.remember("rows", depends, make)["rows"])
    active = min(budget, dictionary.atoms.shape[1])
    if len(chosen) < active:
        raise InputError(
            f"{name}: {len(chosen)} rows cannot determine {active} active atoms; take more rows "
            "or fewer atoms", "reducer.budgets")
    return chosen


def weigh(
    offline: Offline, preconditioner: Preconditioner, name: str, B: FloatArray
) -> FloatArray | None:
    """The preconditioner's matrix (cached), None for the identity.

    InputError when it is undefined for this shape.
    """
    reason = preconditioner.check(*B.shape)
    if reason:
        raise InputError(f"{name}: {reason}", "reducer.preconditioner")
    made = offline.remember(
        "preconditioner", (preconditioner, B), lambda: {"P": preconditioner.build(B)})
    P: FloatArray = np.asarray(made["P"])
    return None if np.array_equal(P, np.eye(len(P))) else P


def numbers(support: BoolArray) -> IntArray | None:
    """Positions of the active atoms; None when all are."""
    return None if support.all() else np.flatnonzero(support)
