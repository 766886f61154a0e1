"""The brake disk with complete bases, coarse: few atoms selected from rows of D^-1 r hold every
field, and few operators are made for a support."""

import numpy as np
import pytest

from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.rigid_stage import staged
from sparsemor.core.testing.in_memory_run import march
from sparsemor.reducers.sparse.supported_steps import SparseStepper

COARSE = {"bodies.disk.mesh": {"use": "disk", "triangles": 300, "rim": 36, "layers": 1},
          "time.end": 0.06, "reducer.sampler.leading": 50,
          "reducer.budgets": {"disk.elastic": {"rows": 150, "atoms": 30},
                              "disk.thermal": {"rows": 120, "atoms": 40},
                              "pad.*": {"rows": 60, "atoms": 25}}}


@pytest.mark.slow
def test_few_atoms_of_complete_bases_hold_every_field() -> None:
    scene = load("brake_disk_recovered", COARSE)
    model = staged(scene, Products(Cache()), new_manager(), BodyCache())
    want = march(scene.using({"reducer": "full"}), model=model)
    run = march(scene, model=model,
                snapshots={n: want.block(n).T for n in model.reducible()})
    for name, d in run.solver.dictionaries.items():
        assert d.atoms.shape[0] == d.atoms.shape[1]
        truth = want.block(name)
        e = np.linalg.norm(d.offset + run.block(name) @ d.atoms.T - truth, axis=1).max()
        assert e < 1e-3 * np.linalg.norm(truth - truth[0], axis=1).max(), name
    assert isinstance(run.solver, SparseStepper)
