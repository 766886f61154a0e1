"""Forces that act for a few steps only, such as those of a stop that a body leaves too soon."""

from collections.abc import Iterator

import numpy as np

from sparsemor.core import Check, Findings, FloatArray, Note, PreparedRun, RunResult
from sparsemor.plugins.checks import place

FEWEST = 10
"""Number of steps of an impact from which its speeds are resolved."""


class ShortImpacts(Check):
    """Impacts that the steps do not resolve: of a force element that acts at times only."""

    order = place("short_impacts")

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        every, h = run.scene.output.every, run.scene.time.step
        forces = result.joint_forces()
        shortest = {name: (min(found) + 1) * every - 1 for name, (what, unit) in
                    result.element_forces.items() if (found := list(impacts(
                        forces[name][what, unit])))}
        return Findings([Note(
            f"{name} acts for {steps} step{'s' if steps > 1 else ''} and no longer, which its "
            f"impact takes {FEWEST} or more of: bodies leave it with wrong speeds, and may gain "
            f"energy. Take time.step of at most {h * steps / FEWEST:.2g} s, or less stiffness",
            "short_impact") for name, steps in shortest.items() if steps < FEWEST])


def impacts(force: FloatArray) -> Iterator[int]:
    """Numbers of stored steps of each time that a force acts, between two times without it."""
    edges = np.flatnonzero(np.diff((force != 0.0).astype(np.int8), prepend=0, append=0))
    for first, end in edges.reshape(-1, 2).tolist():
        if first > 0 and end < len(force):
            yield end - first
