"""Errors of blocks of unknowns: scales to which they are relative, and what a run estimated."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.results.run_result import RunResult

CONSTANT_CHANGE = 1e-9
"""Relative change up to which a block counts as constant: its change is round-off, and an error
relative to that change would be meaningless."""
OF_TOLERANCE = 1e3
"""The same in multiples of the tolerance of an iterative linear solver, whose remainders in a field
at rest add up over the steps."""
LIMIT = 0.1
"""Error above which a run is marked (relative; rad for angles)."""


def constant_change(scene: Mapping[str, Any]) -> float:
    """Relative change up to which a block of a run counts as constant: round-off, and that of
    iterative linear solvers; scene: of the run, as plain data."""
    solvers = [scene.get("linear_solver"), *dict(scene.get("linear_solvers") or {}).values()]
    rtol = max((float(s.get("rtol") or 0.0) for s in solvers if isinstance(s, Mapping)),
               default=0.0)
    return max(CONSTANT_CHANGE, OF_TOLERANCE * rtol)


def estimated_errors(run: RunResult) -> dict[str, FloatArray]:
    """Block -> (j,) error that a run estimated for itself, relative to the block's largest change
    in the run; where that is round-off relative to its initial state."""
    found = {}
    for name in run.error_estimates:
        if run.reduced(name):
            c = run.coefficients(name)
            # |atoms (c - c_0)| = |R (c - c_0)| with atoms = Q R
            moved = (c - c[:1]) @ np.asarray(np.linalg.qr(run.atoms(name), mode="r")).T
        else:  # the run went on at full order
            x = run.block(name)
            moved = x - x[:1]
        change = float(row_norms(moved).max(initial=0.0))
        size = float(row_norms(run.block(name, slice(0, 1))).max(initial=0.0))
        scale = change if change > CONSTANT_CHANGE * size else size
        found[name] = run.error_estimate(name) / (scale or 1.0)
    return found


def row_norms(rows: FloatArray) -> FloatArray:
    """2-norm (T,) of each row (T, n)."""
    # Scaled, because the last steps of a diverged run may be too large to square.
    largest = np.abs(rows).max(axis=1)
    safe = np.where(largest > 0.0, largest, 1.0)
    return np.asarray(largest * np.linalg.norm(rows / safe[:, None], axis=1), dtype=np.float64)
