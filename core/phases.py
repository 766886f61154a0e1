"""Errors during the start-up and after it: the second table of a comparison, and its CSV file."""

from collections.abc import Mapping
from typing import Any

from sparsemor.core.error_measures import LIMIT, START_UP, Errors
from sparsemor.core.text_table import CONSTANT, marked, text_table


def phase_table(
    measured: Mapping[str, Errors], blocks: list[str], limit: float = LIMIT
) -> str:
    """One line a run: `start-up / steady` of the joint error and of each block, by name.

    The joint error is relative to the norm at the same time, blocks to their largest change. A run
    that was compared in one of the two only has `-` for the other. Errors above `limit` are marked.
    """
    end = next((e.start_up_end for e in measured.values()), 0.0)
    head = [f"first {START_UP:.0%} / rest", "joint", *blocks]
    table = [[run, *(CONSTANT if e.still(m) else
                     _pair(e.start_up.get(m), e.steady.get(m), limit) for m in head[1:])]
             for run, e in measured.items()]
    note = f"start-up until {end:.4g} s; relative to the norm at the same time: start_up.csv"
    return "\n".join([text_table([head, *table]), note])


def phase_rows(measured: Mapping[str, Errors]) -> list[list[Any]]:
    """Rows of start_up.csv, one a run and measure. `_present`: relative to the reference's norm at
    the same time, as the paper defines its joint error; empty where there is none."""
    rows: list[list[Any]] = [
        ["run", "measure", "start_up", "steady", "start_up_present", "steady_present"]]
    for run, e in measured.items():
        phases = e.start_up, e.steady, e.start_up_present, e.steady_present
        rows += [[run, m, *(phase.get(m) for phase in phases)] for m in e.series]
    return rows


def _pair(start_up: float | None, steady: float | None, limit: float) -> str:
    return " / ".join(marked(v, ".1e", limit) for v in (start_up, steady))
