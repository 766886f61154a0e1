"""Bordered systems: sparse storage gives the dense solution, and grows as the number of bodies."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.sparse import csc_array

from sparsemor.core.arrays import FloatArray
from sparsemor.reducers.linalg.least_norm import least, sparse_least
from sparsemor.reducers.step.border.sparse import (
    DENSE,
    BandedSystem,
    Bands,
    ColumnSystem,
    Pattern,
    bordered_system,
)
from sparsemor.reducers.step.border.system import BorderedSystem, DenseSystem

Edges = list[tuple[int, int]]
Rng = np.random.Generator
POSE, JOINT = 3, 2


def chain(rng: Rng, n: int) -> Edges:
    return [(i - 1, i) for i in range(1, n)]


def tree(rng: Rng, n: int) -> Edges:
    return [(int(rng.integers(i)), i) for i in range(1, n)]


def star(rng: Rng, n: int) -> Edges:
    return [(0, i) for i in range(1, n)]


def loops(rng: Rng, n: int) -> Edges:
    """A closed chain with a few further joints across it."""
    across = [(a, b) for a, b in rng.integers(0, n, (max(1, n // 8), 2)).tolist() if a != b]
    return [*chain(rng, n), (n - 1, 0), *across]


def binary(rng: Rng, n: int) -> Edges:
    return [((i - 1) // 2, i) for i in range(1, n)]


def ring(rng: Rng, n: int) -> Edges:
    return [*chain(rng, n), (n - 1, 0)]


def ladder(rng: Rng, n: int) -> Edges:
    """Chain with a loop around every two bodies."""
    return [*chain(rng, n), *((i - 2, i) for i in range(2, n))]


GRAPHS: dict[str, Callable[[Rng, int], Edges]] = {
    "chain": chain, "tree": tree, "binary": binary, "star": star, "ring": ring, "ladder": ladder,
    "loops": loops}


def maps_of(rng: Rng, n: int, edges: Edges) -> tuple[list[FloatArray], int, int]:
    """Maps T_i of n bodies, N and n_rigid: each body depends on its pose and on the forces of its
    joints, the first body is held, and forces of some joints are given in turned axes, or depend on
    the pose of the other body."""
    held: list[tuple[int, ...]] = [(0,), *edges]
    size, n_rigid = n * POSE + len(held) * JOINT, n * POSE
    maps = []
    for i in range(n):
        own = np.zeros((POSE, size))
        own[:, i * POSE : (i + 1) * POSE] = np.eye(POSE)
        parts = [own]
        for j, ends in enumerate(held):
            if i not in ends:
                continue
            T = np.zeros((JOINT, size))
            turned = rng.normal(size=(JOINT, JOINT)) if j % 3 == 0 else np.eye(JOINT)
            T[:, n_rigid + j * JOINT : n_rigid + (j + 1) * JOINT] = (
                turned if ends[0] == i else -turned)
            if j % 4 == 1 and ends[0] == i:
                other = np.zeros((POSE, size))
                other[:, ends[-1] * POSE : (ends[-1] + 1) * POSE] = np.eye(POSE)
                parts.append(other)
            parts.append(T)
        maps.append(np.concatenate(parts))
    return maps, size, n_rigid


def filled(rng: Rng, system: BorderedSystem, sizes: Sequence[int], seed: int) -> FloatArray:
    """Values of the bodies' matrices and rows, the same for each system of these sizes."""
    again, matrices = np.random.default_rng(seed), system.matrices()
    for view, b in zip(matrices.views, sizes, strict=True):
        view[:] = again.normal(size=(b, b + 1)) + 4.0 * np.eye(b, b + 1)
    return matrices.values


def systems(rng: Rng, n: int, edges: Edges) -> tuple[list[BorderedSystem], list[int], int]:
    """Dense, banded and columnwise system of the same bodies, sizes of their borders, and
    n_rigid."""
    maps, size, n_rigid = maps_of(rng, n, edges)
    pattern = Pattern(maps, size, n_rigid)
    made: list[BorderedSystem] = [
        DenseSystem(maps, size, n_rigid), BandedSystem(pattern, Bands(pattern)),
        ColumnSystem(pattern)]
    return made, [len(T) for T in maps], n_rigid


@pytest.mark.parametrize("kind", GRAPHS)
@pytest.mark.parametrize("seed", range(3))
def test_sparse_systems_are_the_dense_one(kind: str, seed: int) -> None:
    """Products to round-off, solutions to round-off times the condition number."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(5, 30))
    (dense, *others), sizes, n_rigid = systems(rng, n, GRAPHS[kind](rng, n))
    B, r = dense.assembled(filled(rng, dense, sizes, seed))
    x, v = (rng.normal(size=k) for k in (len(B), n_rigid))
    y = np.abs(x)
    truth = dense.solved(B, x.copy())
    assert truth is not None
    bound = 1e-14 * float(np.linalg.cond(B)) * float(np.linalg.norm(truth))
    amplified = dense.amplified(B, y)
    for s in others:
        C, q = s.assembled(filled(rng, s, sizes, seed))
        for one, two in ((dense.stacked(x), s.stacked(x)),
                         (dense.stacked_rates(v), s.stacked_rates(v)),
                         (dense.stacked_sizes(y), s.stacked_sizes(y)),
                         (r, q), (dense.term_sizes(B, y), s.term_sizes(C, y))):
            np.testing.assert_allclose(two, one, rtol=1e-13, atol=1e-13 * np.abs(one).max())
        for found in (s.solved(C, x.copy()), s.least(C, x)):
            assert found is not None and float(np.linalg.norm(found - truth)) <= bound
        estimate = s.amplified(C, y)
        assert (estimate <= amplified * (1 + 1e-6)).all()
        assert float(np.linalg.norm(estimate)) >= 0.25 * float(np.linalg.norm(amplified))


def test_singular_and_infinite_matrices_are_reported() -> None:
    rng = np.random.default_rng(0)
    n = 20
    made, _, _ = systems(rng, n, chain(rng, n))
    for s in made:
        H, r = s.matrices(), np.ones(n * (POSE + JOINT))
        assert s.solved(s.assembled(H.values)[0], r) is None  # all zero
        for view in H.views:
            view[:] = np.nan
        found = s.solved(s.assembled(H.values)[0], r)
        assert found is not None and not np.isfinite(found).all()


@pytest.mark.parametrize("kind", ["chain", "ring", "ladder", "binary"])
def test_storage_and_work_grow_with_the_number_of_bodies(kind: str) -> None:
    """Entries of the maps and of the assembly, and either bands of constant width, or entries of
    the factors, whose number grows with n log n."""
    counts, widths, fills = [], [], []
    for n in (30, 60, 120):
        rng = np.random.default_rng(1)
        pattern = Pattern(*maps_of(rng, n, GRAPHS[kind](rng, n)))
        counts.append((pattern.map.nnz, pattern.combination.nnz, len(pattern.rows)))
        widths.append(Bands(pattern).width)
        fills.append(pattern.fill())
    growth = np.array(counts[1:]) / np.array(counts[:-1])
    assert growth.max() <= 2.1
    if kind == "binary":
        assert max(fills[1] / fills[0], fills[2] / fills[1]) <= 2.4
    else:
        assert max(widths) <= 1.2 * min(widths)


@pytest.mark.full
def test_storage_follows_the_structure() -> None:
    """Dense matrices for a few unknowns, bands for chains, columns where bands are wide."""
    rng = np.random.default_rng(0)

    def chosen(n: int, edges: Edges) -> type[object]:
        return type(bordered_system(*maps_of(rng, n, edges)))

    assert chosen(DENSE // 5, chain(rng, DENSE // 5)) is DenseSystem
    for n in (12, 100):
        assert chosen(n, chain(rng, n)) is BandedSystem
    assert chosen(100, ring(rng, 100)) is BandedSystem
    assert chosen(100, binary(rng, 100)) is ColumnSystem


def test_a_singular_sparse_system_has_the_solution_of_least_norm() -> None:
    """Two equal multipliers share their force."""
    rng = np.random.default_rng(2)
    A = rng.normal(size=(60, 60))
    A = A + A.T
    A[:, 59], A[59] = A[:, 58], A[58]
    r = A @ rng.normal(size=60)
    found = sparse_least(csc_array(A), r)
    np.testing.assert_allclose(found, least(A, r), rtol=0, atol=1e-10)
    assert abs(found[59] - found[58]) < 1e-10 and float(np.linalg.norm(A @ found - r)) < 1e-10
