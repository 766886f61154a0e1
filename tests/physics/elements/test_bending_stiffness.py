"""Bending stiffness of linear elements, estimated before a run, against quadratic elements."""

from typing import Any

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from sparsemor.bodies.fem.shear_locking import excess_stiffness
from sparsemor.core.model.assembly import assemble
from sparsemor.core.notes import Level
from sparsemor.core.testing.in_memory_run import scene_of

ALUMINIUM = {"E": 7e10, "nu": 0.3, "rho": 2700.0}
BLOCK = {"use": "block", "size": [1.0, 0.1, 0.03]}


def built(order: int = 1, **body: Any) -> Any:
    made = {"use": "flexible", "order": order, "material": ALUMINIUM, "fields": ["elastic"],
            "reference": {"clamp": "left"}, "frame": "fixed", **body}
    model = assemble(scene_of({"bodies": {"b": made}, "time": {"end": 1.0, "step": 1.0}}))
    return model.parts["b"]


def share(**body: Any) -> float:
    made = built(**body)
    return excess_stiffness(made.mesh, made.elasticity, made.thickness)


def tip(order: int, axis: int, **body: Any) -> float:
    """Mean displacement of the end under shear distributed over it."""
    made = built(order, **body)
    e, d = made.elasticity, made.d
    f = np.zeros((len(made.X), d))
    f[:, axis] = made.centre_of("right", made.points["right"]).weights
    u = spsolve(e.stiffness[e.free][:, e.free].tocsc(), f.reshape(-1)[e.free])
    return float(u @ f.reshape(-1)[e.free])


PLANE = {"thickness": 0.02, "mesh": {
    "use": "rectangle", "size": [0.5, 0.05], "divisions": [25, 2]}}
SOLID = {"mesh": {**BLOCK, "divisions": [20, 3, 2]}}


@pytest.mark.full
@pytest.mark.parametrize(("axis", "body"), [(1, {**PLANE, "model": "plane_strain"}), (2, SOLID)])
def test_the_share_is_that_of_a_bent_beam(axis: int, body: dict[str, Any]) -> None:
    """Computed directly: 1 - u_1 / u_2 of the end with the matrices of both orders."""
    exact = 1.0 - tip(1, axis, **body) / tip(2, axis, **body)
    assert exact > 0.3
    assert share(**body) == pytest.approx(exact, rel=0.06)
    assert share(order=2, **body) == 0.0


@pytest.mark.full
def test_a_chord_bends_as_the_free_body() -> None:
    """Its single points carry no load, so they do not count."""
    free = {**PLANE, "sets": {"a": {"nearest": [0.0, 0.0]}, "b": {"nearest": [0.5, 0.0]}},
            "reference": {"chord": ["a", "b"]}}
    other = {**free, "sets": {"a": {"nearest": [0.2, 0.05]}, "b": {"nearest": [0.3, 0.0]}}}
    assert share(**free) == pytest.approx(share(**PLANE), rel=0.1)
    assert share(**other) == pytest.approx(share(**free), rel=1e-3)


def test_a_part_of_another_material_is_bent_with_its_own_stiffness() -> None:
    soft = {**ALUMINIUM, "E": 7e6}
    mixed = {**PLANE, "sets": {"end": {"where": "x > 0.2499"}}, "materials": {"end": soft}}
    short = {**PLANE, "mesh": {**PLANE["mesh"], "size": [0.26, 0.05],  # type: ignore[dict-item]
                               "divisions": [13, 2]}}
    assert share(**mixed) == pytest.approx(share(**short), rel=0.1)


@pytest.mark.full
@pytest.mark.parametrize(("body", "low", "high"), [
    ({"mesh": {"use": "link"}, "thickness": 0.02, "reference": {"chord": ["chord_a", "chord_b"]}},
     0.05, 0.06),
    ({"mesh": {"use": "link", "elements": 5120}, "thickness": 0.02,
      "reference": {"chord": ["chord_a", "chord_b"]}}, 0.01, 0.02)])
def test_links_of_the_packaged_scenes(body: dict[str, Any], low: float, high: float) -> None:
    """The link of 1280 triangles is 5 % too stiff, one of 5120 a quarter of that."""
    assert low < share(**body) < high


@pytest.mark.full
def test_the_block_of_the_documentation_is_noted() -> None:
    made = built(mesh={**BLOCK, "divisions": [40, 8, 3]})
    (note,) = made.notes
    assert note.kind == "stiff_in_bending" and note.level is Level.WARNING
    assert "order: 2" in note.text


@pytest.mark.full
def test_what_is_fine_enough_has_no_note() -> None:
    fine = built(**{**PLANE, "mesh": {**PLANE["mesh"], "divisions": [60, 12]}})  # type: ignore
    assert fine.notes == ()
    assert built(order=2, **PLANE).notes == ()
