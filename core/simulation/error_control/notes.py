"""Notes on the estimated error of a run and on what followed from it."""

from collections.abc import Sequence

from sparsemor.core.notes import Note, information


def enrichment_notes(times: Sequence[float], steps: int) -> tuple[Note, ...]:
    """Note on atoms that were added at some times, s, from `steps` full-order steps."""
    return () if not times else (information(
        f"atoms were added {len(times)} times, first at {times[0]:.4g} s, because the estimated "
        f"error exceeded its tolerance; {steps} steps of the run were solved at full order",
        "enriched"),)
