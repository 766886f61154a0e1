"""Memory of a run: peak, estimate and what was available."""

from dataclasses import dataclass

from sparsemor.core.simulation.memory.limits import GIGABYTE, ceiling, peak


@dataclass(frozen=True, slots=True)
class MemoryUse:
    """Bytes. expected: in all, as estimated before; offline: the most until the first step."""

    expected: float | None
    offline: int

    def summary(self) -> dict[str, float]:
        """GB. peak_gb: the most that the process has held since it began; peak_offline_gb: until
        the first step; expected_gb: as estimated in advance, at most; available_gb: what it could
        hold when the run ended."""
        expected = {} if self.expected is None else {"expected_gb": self.expected / GIGABYTE}
        return {"peak_gb": peak() / GIGABYTE, "peak_offline_gb": self.offline / GIGABYTE,
                **expected, "available_gb": ceiling() / GIGABYTE}
