"""Memory of a run: peak, estimate and available memory."""

from dataclasses import dataclass

from sparsemor.core.simulation.memory.limits import GIGABYTE, ceiling, peak


@dataclass(frozen=True, slots=True)
class MemoryUse:
    """Memory of a run, bytes. expected: estimated total, None without an estimate; offline: peak
    until the first step."""

    expected: float | None
    offline: int

    def summary(self) -> dict[str, float]:
        """Summary entries, GB. peak_gb: peak of the process; peak_offline_gb: its peak until the
        first step; expected_gb: estimate in advance; available_gb: memory limit of the process at
        the end of the run."""
        expected = {} if self.expected is None else {"expected_gb": self.expected / GIGABYTE}
        return {"peak_gb": peak() / GIGABYTE, "peak_offline_gb": self.offline / GIGABYTE,
                **expected, "available_gb": ceiling() / GIGABYTE}
