"""Bodies in space that stand still, or have a mesh and no field."""

from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core.model.assembly import assemble
from sparsemor.core.testing.in_memory_run import March, march, scene_of

BAR: dict[str, Any] = {
    "use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
    "material": {"E": 2e8, "nu": 0.3, "rho": 1100},
    "mesh": BlockMesh(lower=(-0.1, -0.05, -0.03), size=(0.5, 0.1, 0.06), divisions=(6, 2, 1)),
    "pose": {"position": [0.3, -0.2, 0.1], "axis": [1, 2, 3], "angle": 0.4}}


@pytest.mark.full
def test_a_frame_at_rest_costs_no_inertia_but_that_of_the_displacements() -> None:
    """No generators and no inertia directions; the same motion as a Newton that has them all."""
    load_at_end = {"use": "point_force", "on": "bar:right", "force": [0.0, 3.0, 20.0]}

    def swing(method: str) -> March:
        return march(scene_of({
            "bodies": {"bar": {**BAR, "frame": "fixed"}},
            "loads": {"pull": load_at_end, "weight": {"use": "gravity"}},
            "reducer": {"use": "full", "method": method}, "time": {"end": 0.02, "step": 1e-3}}))

    got, whole = swing("bordered"), swing("newton")
    (moving,) = got.model.separated.moving
    assert moving.operators is not None
    assert moving.operators.generators == () and moving.frame.generators == 0
    assert moving.operators.directions.shape[1] == 2 * 3  # of the force and of the weight
    assert np.abs(whole.x).max() > 1e-4
    np.testing.assert_allclose(got.x, whole.x, rtol=0, atol=1e-8 * np.abs(whole.x).max())


def test_a_body_without_fields_is_rigid_with_the_mass_and_shape_of_its_mesh() -> None:
    rigid_copy = {**BAR, "fields": []}
    body = assemble(scene_of({"bodies": {"bar": rigid_copy}, "time": {"end": 1.0, "step": 0.1}}))
    assert {b.name for b in body.layout} == {"bar.rigid", "bar.multiplier"}
    part: Any = body.parts["bar"]
    sides, middle = np.array([0.5, 0.1, 0.06]), np.array([0.15, 0.0, 0.0])
    mass = 1100 * sides.prod()
    second = mass * (np.diag(sides**2) / 12 + np.outer(middle, middle))
    np.testing.assert_allclose(part.inertia.mass, mass)
    np.testing.assert_allclose(part.inertia.moment, mass * middle, atol=1e-12)
    np.testing.assert_allclose(part.inertia.second, second, rtol=1e-12, atol=1e-14)
