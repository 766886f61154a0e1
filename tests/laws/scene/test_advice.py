"""Advice fits the method: rows are mentioned where rows are sampled, and nowhere else."""

from pathlib import Path

import pytest

from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.status import SolveFailed, Status

TINY = Path(__file__).parents[2] / "scenes" / "tiny.yaml"
TWINS = """
import numpy as np
from sparsemor.core import Basis, Dictionary


class Twins(Basis):
    'Two atoms that differ in one row, which is not sampled.'
    needs_snapshots = False

    def build(self, data):
        atoms = np.full((data.size, 2), data.size ** -0.5)
        atoms[data.size // 2, 1] = 0.0
        return Dictionary(atoms, np.zeros(data.size), ("one", "two"))
"""


@pytest.mark.full
def test_rows_are_advised_on_where_there_are_rows(distribute, here):
    distribute("twins", {"basis": {"twins": "mod_advice:Twins"}}, mod_advice=TWINS)
    scene = load(TINY, {"time.end": 0.002, "reducer": {
        "use": "sparse", "budgets": {"*": {"rows": 12}}, "basis": "twins"}})
    with pytest.raises(SolveFailed) as caught:
        simulate(scene)
    assert caught.value.status is Status.RANK_DEFICIENT
    advice = str(caught.value).rpartition("): ")[2]
    assert "rows" in advice and "sampler" in advice and "fewer atoms" in advice


@pytest.mark.parametrize("status", Status)
def test_no_advice_without_rows_mentions_them(status):
    if status is not Status.INFEASIBLE:  # which only a solver for sampled rows reports
        assert "row" not in status.advice_for(sampled=False)
    assert status.advice.startswith(status.advice_for(sampled=False))
