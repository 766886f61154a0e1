"""What storing a run takes beside its steps, and making full fields of what is stored."""

import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from modules import report

from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.comparison.cost import run_facts


def fill(
    table: report.Table, runs: Mapping[str, RunResult], blocks: tuple[str, ...], folder: Path
) -> None:
    """ms a step: wall time of the run less the median of its solver's steps; CPU time of
    `RunResult.block` over all stored steps; CPU time of writing these fields to files."""
    for name, stored in runs.items():
        facts = run_facts(stored)
        assert facts.ms_per_step is not None and facts.ms_per_step_solver is not None
        begun = time.process_time()
        fields = [stored.block(block) for block in blocks]
        made = time.process_time()
        for block, values in zip(blocks, fields, strict=True):
            np.save(folder / f"{block}.npy", values)
        written = time.process_time()
        steps = len(fields[0])
        table.add(run=name, steps=facts.steps, step=facts.ms_per_step_solver,
                  storing=facts.ms_per_step - facts.ms_per_step_solver,
                  fields=1e3 * (made - begun) / steps, files=1e3 * (written - made) / steps)
