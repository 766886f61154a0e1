"""Law kit of a sampler."""

import numpy as np

from sparsemor.core.arrays import IntArray
from sparsemor.core.protocols.basis import BlockData, Dictionary
from sparsemor.core.protocols.sampler import Sampler
from sparsemor.core.testing.random_inputs import (
    copied,
    keeps_contract,
    law,
    random_block,
    random_dictionary,
    refused,
    unchanged,
)


def check_sampler(sampler: Sampler, seed: int = 0, trials: int = 30) -> None:
    """Laws of a sampler (selects the m rows of a block at which its equations are evaluated):
    sorted distinct rows, the required ones and m more, that depend on the random generator alone.

    A sampler with an option `required = False` must return m rows, whatever is required; one with
    `required = "ring"` also keeps the rows around the path of moving loads; one with `unit =
    "node"` returns whole nodes, except for the last one. More rows than unknowns raise InputError.
    """
    keeps_contract("sampler", sampler)
    forces = sampler.keeps != "none"
    for trial in range(trials):
        rng = np.random.default_rng([seed, trial])
        block = random_block(rng)
        n = block.size
        required = np.sort(rng.choice(n, int(rng.integers(0, n // 3)), replace=False))
        given = required = required.astype(np.int64)
        if sampler.keeps == "ring":  # these rows are kept, too
            required = np.union1d(required, block.ring)
        left = n - required.size if forces else n
        m = left if trial == 0 else int(rng.integers(0 if forces else 1, left + 1))
        dictionary = random_dictionary(n, max(1, min(m, n)), rng)
        where = f"(seed {seed}, trial {trial}: {n} unknowns, {required.size} required, m = {m})"
        rows = _repeatable(sampler, block, m, dictionary, given, [seed, trial], where)
        _well_formed(rows, n, where)
        if forces:
            missing = np.setdiff1d(required, rows)
            law(missing.size == 0, f"required rows {missing[:5]} are missing {where}")
        wanted = m + (required.size if forces else 0)
        law(rows.size == wanted, f"{rows.size} rows instead of {wanted} {where}")
        if sampler.whole_nodes:
            _whole_nodes(block, rows, required if forces else required[:0], where)
    _refuses_too_many(sampler, random_block(np.random.default_rng(seed)))


def _repeatable(
    sampler: Sampler, block: BlockData, m: int, dictionary: Dictionary, required: IntArray,
    seed: list[int], where: str,
) -> IntArray:
    """The sampled rows, which a generator of the same seed must give again; the sampler must not
    write to its inputs."""
    before = copied(block) + copied(dictionary) + [required.copy()]
    first, again = (
        sampler.sample(block, m, dictionary, np.random.default_rng(seed), required)
        for _ in range(2)
    )
    law(unchanged(block, before[: len(copied(block))])
        and unchanged(dictionary, before[len(copied(block)) : -1])
        and np.array_equal(required, before[-1]), f"the sampler wrote to its inputs {where}")
    law(np.array_equal(first, again),
        f"two generators of the same seed give different rows {where}: draw from `rng` only")
    return first


def _well_formed(rows: IntArray, n: int, where: str) -> None:
    law(isinstance(rows, np.ndarray) and rows.ndim == 1 and rows.dtype == np.int64,
        f"rows must be a 1-D int64 array {where}")
    law((np.diff(rows) > 0).all(), f"rows must be sorted and distinct {where}")
    law(rows.size == 0 or (rows[0] >= 0 and rows[-1] < n), f"rows outside 0..{n - 1} {where}")


def _whole_nodes(block: BlockData, rows: IntArray, required: IntArray, where: str) -> None:
    """Checks that, apart from required rows, at most one node is sampled in part."""
    node = np.unique(block.coordinates, axis=0, return_inverse=True)[1].reshape(-1)
    drawn = np.unique(node[np.setdiff1d(rows, required)])
    open_rows = np.setdiff1d(np.arange(block.size), rows)
    partly = np.intersect1d(drawn, node[open_rows])
    law(partly.size <= 1, f"{partly.size} nodes were drawn in part, with unit: node {where}")


def _refuses_too_many(sampler: Sampler, block: BlockData) -> None:
    n, rng = block.size, np.random.default_rng(0)
    dictionary = random_dictionary(n, n, rng)
    refused(f"m = n + 1 = {n + 1} rows of {n}", lambda: sampler.sample(
        block, n + 1, dictionary, rng, np.zeros(0, dtype=np.int64)))
