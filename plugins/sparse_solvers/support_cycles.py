"""The supports met during one solve, and the best iterate on each."""

from sparsemor.core import SparseOutcome


class Visits:
    """Local to one solve: nothing of it outlives the call."""

    def __init__(self) -> None:
        self._best: dict[bytes, SparseOutcome] = {}
        self._last = b""

    def note(self, iterate: SparseOutcome) -> bool:
        """Records an iterate; True when its support was left before and has come back."""
        key = iterate.support.tobytes()
        cycle = key in self._best and key != self._last
        if key not in self._best or iterate.residual_norm < self._best[key].residual_norm:
            self._best[key] = iterate
        self._last = key
        return cycle

    def best(self) -> SparseOutcome:
        """The iterate of least residual norm (one at least was noted)."""
        return min(self._best.values(), key=lambda iterate: iterate.residual_norm)
