"""Anderson acceleration of a fixed-point iteration that contracts slowly, or not at all.

The iteration of a step keeps its elastic operator D constant, which is a poor approximation for
soft bodies that spin fast. There the last few iterates are combined so that the norm of their
residuals is least (Anderson 1965, doi 10.1145/321296.321305), which for a nearly linear problem is
GMRES without additional solves.
"""

import numpy as np

from sparsemor.core import FloatArray

DEPTH = 8


class Anderson:
    """Anderson acceleration with the iterates of one step."""

    def __init__(self) -> None:
        self._residuals: list[FloatArray] = []
        self._images: list[FloatArray] = []

    def mix(self, before: FloatArray, after: FloatArray, weights: FloatArray) -> FloatArray:
        """Next iterate from one application `before -> after` of the iteration and the previous
        ones; weights (n,): scale of each unknown's residual, 0 to ignore it."""
        self._residuals = [*self._residuals[-DEPTH:], after - before]
        self._images = [*self._images[-DEPTH:], after]
        if len(self._residuals) < 2:
            return after
        dF, dG = (np.diff(np.stack(rows), axis=0) for rows in (self._residuals, self._images))
        gamma = np.linalg.lstsq((dF * weights).T, self._residuals[-1] * weights, rcond=1e-10)[0]
        return np.asarray(after - gamma @ dG)
