"""The start of a run satisfies the equations of motion to rounding."""

import numpy as np
import pytest

from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.equations import system_residual
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.scene.scene import load


@pytest.mark.full
def test_accelerations_and_joint_forces_balance_the_weight() -> None:
    """A mass that is lost next to the stiffness leaves 1e-6 of the weight and more open."""
    scene = load("double_pendulum", {
        "bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320})
    model = assemble(scene)
    start, zero = consistent_state(model), np.zeros(model.layout.size)
    left = system_residual(model.layout, model.terms, start.x, start.v, start.a, 0.0)
    pulled = system_residual(model.layout, model.terms, model.x0, model.v0, zero, 0.0)
    for body in ("link1", "link2"):
        for field in ("rigid", "elastic"):
            at = model.layout[f"{body}.{field}"]
            assert np.abs(left[at]).max() < 1e-12 * np.abs(pulled[at]).max(), (body, field)
