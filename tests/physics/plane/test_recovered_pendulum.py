"""The double pendulum with complete bases and atoms selected in each step: sampled rows of D^-1 r
recover every field to 1e-8; sampled rows of r leave the displacements thousands of times less
accurate."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.testing.in_memory_run import March, march

COARSE = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320, "time.end": 0.1,
          "reducer.budgets": {"*.elastic": {"rows": 120, "atoms": 40},
                              "*.thermal": {"rows": 60, "atoms": 20}}}


@cache
def full(whole: bool) -> tuple[Scene, Model, March]:
    scene = load("double_pendulum_recovered", {} if whole else COARSE)
    model = assemble(scene)
    return scene, model, march(scene.using({"reducer": "full"}), model=model)


def errors(changes: dict[str, Any], whole: bool = False) -> dict[str, float]:
    """Largest error of each field over the run, start included, relative to its largest change."""
    scene, model, want = full(whole)
    run = march(scene.using(changes), model=model,
                snapshots={n: want.block(n).T for n in model.reducible()})
    found: dict[str, float] = {}
    for name, d in run.solver.dictionaries.items():
        assert d.atoms.shape[0] == d.atoms.shape[1]
        truth = want.block(name)
        e = np.linalg.norm(d.offset + run.block(name) @ d.atoms.T - truth, axis=1).max()
        field = name.partition(".")[2]
        e /= np.linalg.norm(truth - truth[0], axis=1).max()
        found[field] = max(found.get(field, 0.0), float(e))
    return found


@pytest.mark.full
def test_rows_of_the_preconditioned_residual_recover_every_field_and_plain_rows_do_not() -> None:
    found = errors({"seed": 2})
    assert found["elastic"] < 1e-8 and found["thermal"] < 1e-8
    assert errors({"reducer.residual": "plain"})["elastic"] > 1e-5


@pytest.mark.slow
def test_the_packaged_scene_is_recovered_over_its_whole_run() -> None:
    found = errors({"check_stability": "off"}, whole=True)
    assert found["elastic"] < 1e-8 and found["thermal"] < 1e-8
