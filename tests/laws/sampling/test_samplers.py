"""Strata, nodes and refusals of the samplers; what their law kit catches."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sparsemor.core import BlockData, Dictionary, Sampler
from sparsemor.core.arrays import IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.testing import check_sampler
from sparsemor.core.testing.random_inputs import random_block, random_dictionary
from sparsemor.plugins.samplers.candidate_rows import RowSampler
from sparsemor.plugins.samplers.lhs import LatinHypercube, one_per_stratum
from sparsemor.plugins.samplers.random import Uniform

NONE = np.zeros(0, dtype=np.int64)


@pytest.mark.parametrize("kind", [LatinHypercube, Uniform])
@pytest.mark.parametrize("required", [True, False])
def test_options_keep_the_laws(kind: type[RowSampler], required: bool) -> None:
    check_sampler(kind(required=required, unit="node"), seed=1, trials=5)
    check_sampler(kind(required=required), seed=2, trials=5)


def plane(nodes: int) -> BlockData:
    """Displacements of `nodes` points in the plane: two rows a node."""
    block = random_block(np.random.default_rng(0))
    places = np.random.default_rng(1).random((nodes, 2))
    return replace(block, coordinates=np.repeat(places, 2, axis=0), name="link.elastic")


def draw(sampler: Sampler, block: BlockData, m: int, required: IntArray, seed: int = 0) -> IntArray:
    dictionary = random_dictionary(block.size, 2, np.random.default_rng(0))
    return sampler.sample(block, m, dictionary, np.random.default_rng(seed), required)


@given(st.integers(1, 300), st.data())
@settings(max_examples=20)
def test_each_stratum_gives_one_row(N: int, data: st.DataObject) -> None:
    m = data.draw(st.integers(1, N))
    rows = one_per_stratum(N, m, np.random.default_rng(N))
    ends = np.arange(1, m + 1) * N // m
    assert np.array_equal(np.searchsorted(ends, rows, side="right"), np.arange(m))


@pytest.mark.full
@pytest.mark.parametrize("sampler", [LatinHypercube(), Uniform()], ids=repr)
def test_every_row_is_equally_likely(sampler: Sampler) -> None:
    block, runs = plane(10), 1000
    counts = np.zeros(20)
    for seed in range(runs):
        counts[draw(sampler, block, 5, NONE, seed)] += 1
    # 5 of 20 rows: mean runs / 4, standard deviation below 14
    assert np.abs(counts - runs / 4).max() < 5 * 14


@pytest.mark.parametrize("kind", [LatinHypercube, Uniform])
def test_whole_nodes_are_taken(kind: type[LatinHypercube]) -> None:
    block = plane(100)
    rows = draw(kind(unit="node"), block, 41, NONE)
    on_node = np.bincount(rows // 2, minlength=100)
    assert (on_node == 2).sum() == 20 and (on_node == 1).sum() == 1


def test_whole_nodes_leave_out_required_rows() -> None:
    required = np.arange(0, 40, 2, dtype=np.int64)  # one row of each of the first 20 nodes
    rows = draw(LatinHypercube(unit="node"), plane(20), 20, required)
    assert np.array_equal(rows, np.arange(40))


@pytest.mark.full
def test_published_variant_neither_forces_nor_excludes_required_rows() -> None:
    required = np.array([3, 7], dtype=np.int64)
    hits = np.zeros(20)
    for seed in range(200):
        hits[draw(LatinHypercube(required=False), plane(10), 5, required, seed)] += 1
    assert 0 < hits[3] < 200 and 0 < hits[7] < 200


def test_too_many_rows_are_refused_with_the_numbers() -> None:
    required = np.arange(5, dtype=np.int64)
    with pytest.raises(InputError, match="16 rows .* link.elastic.* 15 .* 5 required"):
        draw(LatinHypercube(), plane(10), 16, required)


class Broken(Uniform):
    fault: str

    def sample(
        self,
        block: BlockData,
        m: int,
        dictionary: Dictionary,
        rng: np.random.Generator,
        required: IntArray,
    ) -> IntArray:
        if self.fault == "own randomness":
            rng = np.random.default_rng()
        if self.fault == "clips":
            m = min(m, block.size)
        if self.fault == "forgets the required":
            return super().sample(block, m + required.size, dictionary, rng, required[:0])
        if self.fault == "splits nodes":
            return Uniform().sample(block, m, dictionary, rng, required)
        rows = super().sample(block, m, dictionary, rng, required)
        if self.fault == "unsorted":
            return rows[::-1]
        if self.fault == "repeats":
            return np.sort(np.concatenate([rows[1:], rows[-1:]]))
        if self.fault == "one too few":
            return np.union1d(required, rows[~np.isin(rows, required)][1:])
        if self.fault == "writes":
            required *= 0
        return rows


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("own randomness", "same seed"),
        ("clips", "but it was accepted"),
        ("forgets the required", "are missing"),
        ("unsorted", "sorted and distinct"),
        ("repeats", "sorted and distinct"),
        ("one too few", "rows instead of"),
        ("writes", "wrote to its inputs"),
        ("splits nodes", "drawn in part"),
    ],
)
def test_a_broken_sampler_fails_its_law(fault: str, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        check_sampler(Broken(fault=fault, unit="node" if fault == "splits nodes" else "dof"))
