"""What a run of a reduced model was learnt from, and what it says in full unknowns."""

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March


def learnt(run: March) -> dict[str, FloatArray]:
    """Block -> (n, T) what `run` was at, as snapshots."""
    return {n: run.block(n).T for n in run.model.reducible()}


def decoded(run: March, name: str) -> FloatArray:
    """(T, n) a block in its full unknowns."""
    x, maps = run.block(name), run.solver.dictionaries
    return x if name not in maps else np.asarray(maps[name].offset + x @ maps[name].atoms.T)
