"""Wrong contacts are refused in words, with the key of what is wrong."""

from pathlib import Path
from typing import Any

import pytest

from sparsemor.core.errors import InputError
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.status import SolveFailed, Status
from sparsemor.core.testing.in_memory_run import scene_of

NORMAL = {"use": "elastic_foundation", "stiffness": 1e9}
COULOMB = {"use": "coulomb", "coefficient": 0.3, "critical_velocity": 0.01}


def plate(lower: list[float], **options: Any) -> dict[str, Any]:
    mesh = {"use": "rectangle", "lower": lower, "size": [0.1, 0.1], "divisions": [4, 4]}
    return {"use": "flexible", "mesh": mesh, "thickness": 0.02, "fields": [], **options,
            "material": {"rho": 1000, "k": 45, "c": 480, "E": 1e9, "nu": 0.3}}


def tree(
    contact: dict[str, Any] | None = None, block: dict[str, Any] | None = None,
    base: dict[str, Any] | None = None, **others: Any,
) -> dict[str, Any]:
    sole = {"use": "polygonal", "between": ["block:bottom", "base:top"], "normal": NORMAL}
    return {
        "bodies": {"block": plate([0.0, 0.0], **(block or {})),
                   "base": plate([0.0, -0.1], frame="fixed", **(base or {})),
                   "ball": {"use": "rigid", "mass": 1.0, "inertia": 1.0,
                            "points": {"low": [0.0, 0.0]}}},
        "contacts": {"sole": sole | (contact or {})},
        "time": {"end": 1e-3, "step": 1e-4}, "integrator": "bdf1", **others}


def refused(given: dict[str, Any]) -> str:
    with pytest.raises(InputError) as error:
        checked_model(scene_of(given))
    return str(error.value)


@pytest.mark.parametrize(("contact", "words"), [
    ({"between": ["ball:low", "base:top"]},
     "contacts.sole.between.0: 'ball:low': body 'ball' has no mesh"),
    ({"between": ["block:botom", "base:top"]}, "did you mean bottom"),
    ({"between": ["bloc:bottom", "base:top"]}, "did you mean block?"),
    ({"between": ["block:bottom", "block:top"]},
     "contacts.sole.between: both surfaces are on body 'block'"),
    ({"between": ["block:bottom_left", "base:top"]},
     "contacts.sole.between.0: none of the body's boundary edges"),
    ({"normal": NORMAL | {"stiffness": -1e9}},
     "contacts.sole.normal.stiffness: Input should be greater than 0 (got -1000000000.0)"),
    ({"normal": NORMAL | {"damping": 1e3}},
     "contacts.sole.normal.damping_depth: missing: damping that sets in at once"),
    ({"friction": {"use": "coulomb", "coefficient": 0.3}},
     "contacts.sole.friction.critical_velocity: is missing"),
    ({"friction": COULOMB | {"critical_velocity": 0.0}},
     "contacts.sole.friction.critical_velocity: Input should be greater than 0"),
    ({"friction": COULOMB | {"coefficient": -0.3}},
     "contacts.sole.friction.coefficient: Input should be greater than or equal to 0"),
    ({"heat": {"share": 1.5}}, "contacts.sole.heat.share: Input should be less than or equal to 1"),
    ({"heat": {"conductance": -1.0}}, "contacts.sole.heat.conductance"),
    ({"surfaces": "deformed"}, "contacts.sole.surfaces: neither body has an elastic field"),
    ({"tolerance": 0.0}, "contacts.sole.tolerance: Input should be greater than 0"),
    ({"normal": "hard"}, "contacts.sole.normal"),
])
def test_a_wrong_contact_is_told_under_its_key(contact: dict[str, Any], words: str) -> None:
    assert words in refused(tree(contact))


@pytest.mark.parametrize("height", [-0.02, -0.003, -0.09])
def test_bodies_that_overlap_at_the_start_are_refused(height: float) -> None:
    told = refused(tree(block={"pose": {"position": [0.013, height]}}))
    assert "contacts.sole.between: bodies 'block' and 'base' overlap at the start" in told
    assert "correct a pose" in told


@pytest.mark.parametrize("height", [-0.002, 0.0, 0.05])
def test_a_slight_penetration_and_a_gap_are_accepted(height: float) -> None:
    checked_model(scene_of(tree(block={"pose": {"position": [0.013, height]}})))


def test_a_small_block_on_a_coarse_base_is_found_to_overlap_from_either_side() -> None:
    """No point of the base's surface is in the block, or none of the block's in the base."""
    small = {"use": "rectangle", "lower": [0.0, 0.0], "size": [0.01, 0.01], "divisions": [1, 1]}
    coarse = {"use": "rectangle", "lower": [0.0, -0.1], "size": [0.1, 0.1], "divisions": [1, 1]}
    for between in (["block:bottom", "base:top"], ["base:top", "block:bottom"]):
        told = refused(tree({"between": between}, {"mesh": small, "pose": {
            "position": [0.045, -0.005]}}, {"mesh": coarse}))
        assert "overlap at the start" in told


def test_heat_needs_to_know_both_bodies() -> None:
    hot = {"fields": ["thermal"]}
    told = refused(tree({"heat": {"conductance": 10.0}, "friction": COULOMB}, block=hot))
    assert "contacts.sole.heat.share: body 'base' has no thermal field" in told
    assert "contacts.sole.heat.conductance: body 'base' has no thermal field" in told
    checked_model(scene_of(tree({"heat": {"share": 0.4}, "friction": COULOMB}, block=hot)))


def test_names_of_contacts_are_shared_with_joints_and_loads() -> None:
    given = tree(loads={"sole": {"use": "gravity", "g": [0.0, -9.81]}})
    with pytest.raises(InputError, match="taken in contacts: bodies, joints, contacts and loads"):
        scene_of(given)


def test_a_contact_of_a_body_that_failed_is_not_blamed_too() -> None:
    given = tree()
    given["bodies"]["block"]["fields"] = ["thermal"]
    del given["bodies"]["block"]["material"]["k"]
    told = refused(given)
    assert "bodies.block.material.k" in told and "contacts" not in told


def brick(height: float = 0.0, **options: Any) -> dict[str, Any]:
    mesh = {"use": "block", "size": [0.1, 0.1, 0.1], "divisions": [2, 2, 2]}
    return {"use": "flexible", "fields": [], "material": {"rho": 1000}, "mesh": mesh,
            "pose": {"position": [0.0, 0.0, height]}, **options}


def test_a_plane_body_does_not_touch_one_in_space() -> None:
    for between in (["brick:bottom", "base:top"], ["base:top", "brick:bottom"]):
        told = refused(tree({"between": between}) | {"bodies": {
            "brick": brick(), "base": plate([0.0, -0.1], frame="fixed")}})
        assert ("contacts.sole.between: body 'base' is in the plane and body 'brick' in space"
                in told)


@pytest.mark.parametrize("height", [0.09, 0.02])
def test_bodies_in_space_that_overlap_at_the_start_are_refused(height: float) -> None:
    given = tree({"between": ["block:bottom", "base:top"]}) | {"bodies": {
        "block": brick(height), "base": brick(frame="fixed")}}
    assert "contacts.sole.between: bodies 'block' and 'base' overlap" in refused(given)
    touching = given["bodies"] | {"block": brick(0.097)}  # less than a tenth of a facet
    checked_model(scene_of(given | {"bodies": touching}))


@pytest.mark.full
def test_surfaces_that_never_meet_are_told_at_the_end(tmp_path: Path) -> None:
    apart = tree(block={"pose": {"position": [0.0, 0.05]}})
    result = simulate(scene_of(apart), out=tmp_path / "apart", cache=Cache(tmp_path))
    (told,) = [n for n in result.summary["notes"] if "never met" in n]
    assert "contact sole" in told and "0.05 m" in told
    hot = {"fields": ["thermal"], "pose": {"position": [0.0, 0.05], "spin": 1.0}}
    stages = tree(block=hot, rigid_stage={})
    result = simulate(scene_of(stages), out=tmp_path / "stages", cache=Cache(tmp_path))
    assert [n for n in result.summary["notes"] if "contact sole" in n and "never met" in n]
    meeting = tree(block={"pose": {"position": [0.0, 1e-4], "velocity": [0.0, -1.0]}})
    result = simulate(scene_of(meeting), out=tmp_path / "meeting", cache=Cache(tmp_path))
    assert not [n for n in result.summary["notes"] if "never met" in n]


def test_a_step_too_long_ends_with_advice(tmp_path: Path) -> None:
    fast = tree(block={"pose": {"position": [0.0, 0.001], "velocity": [0.0, -400.0]}})
    with pytest.raises(SolveFailed) as failure:
        simulate(scene_of(fast), out=tmp_path / "run", cache=Cache(tmp_path))
    assert failure.value.status is Status.NOT_CONVERGED
    assert "contact sole: a point of block went" in str(failure.value)
    assert "smaller time.step" in str(failure.value)
