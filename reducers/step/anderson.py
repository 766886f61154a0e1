"""Anderson acceleration of a fixed-point iteration that contracts slowly, or not at all.

The bordered iteration keeps D constant. Soft bodies that spin fast are far from D: there the last
few iterates are combined so that their residuals cancel best (Anderson 1965,
doi 10.1145/321296.321305), which on a nearly linear problem is GMRES at no extra solves.
"""

import numpy as np

from sparsemor.core import FloatArray

DEPTH = 8


class Anderson:
    """Lives through one step. weights (n,): scale of each unknown's residual, 0 to ignore it."""

    def __init__(self) -> None:
        self._residuals: list[FloatArray] = []
        self._images: list[FloatArray] = []

    def mix(self, before: FloatArray, after: FloatArray, weights: FloatArray) -> FloatArray:
        """The next iterate from one application `before -> after` and those remembered."""
        self._residuals = [*self._residuals[-DEPTH:], after - before]
        self._images = [*self._images[-DEPTH:], after]
        if len(self._residuals) < 2:
            return after
        dF, dG = (np.diff(np.stack(rows), axis=0) for rows in (self._residuals, self._images))
        gamma = np.linalg.lstsq((dF * weights).T, self._residuals[-1] * weights, rcond=1e-10)[0]
        return np.asarray(after - gamma @ dG)
