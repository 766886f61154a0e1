"""Why a support stays: what most steps repeat that follow with the same Gram matrix."""

from typing import NamedTuple

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.screening import Quadratic
from sparsemor.plugins.sparse_solvers.gram import Move, Normal
from sparsemor.plugins.sparse_solvers.largest import Largest, Tolerance


class Refusal(NamedTuple):
    """Why a support stays, where all columns may enter: those of least squares on all of them that
    are largest are its own (move None), or fit worse."""

    gram: FloatArray
    support: BoolArray
    everyone: Normal
    order: Largest
    move: Move | None
    longest: float

    def stands(self, at: Quadratic, support: BoolArray) -> bool:
        """Is it all true again?"""
        if support is not self.support or at.gram is not self.gram:
            return False
        step = self.everyone.solve(at.slope)
        close = Tolerance(at.error.sizes, self.everyone.rounding(step) * self.longest)
        if not self.order.holds(np.abs(at.lengths * (at.c - step)), close):
            return False
        if self.move is None:
            return True
        rise, error = self.move.rise(at)
        return rise > error
