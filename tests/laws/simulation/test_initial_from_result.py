"""A run that starts from the state of a stored result goes on as that run did."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import InputError, load, simulate
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.comparison.error_norms import measure_errors

pytestmark = pytest.mark.full
SCENES = Path(__file__).parents[2] / "scenes"
SWING, SLIDER = SCENES / "swing.yaml", SCENES / "small_slider.yaml"
FULL: dict[str, Any] = {"reducer": "full", "time.end": 0.05, "training.end": 0.05}
GALERKIN = {"use": "galerkin", "basis": {"use": "pod", "count": 6}}


@pytest.fixture
def earlier(tmp_path: Path) -> RunResult:
    return simulate(load(SWING, FULL), out=tmp_path / "earlier")


def difference(run: RunResult, earlier: RunResult, first: int) -> dict[str, float]:
    """Block -> largest difference from the earlier run after that many steps, relative to its
    largest change."""
    found = {}
    for b in run.layout:
        if b.kind.order > 0:
            x, y = run.block(b.name), earlier.block(b.name)
            found[b.name] = np.abs(x - y[first:first + len(x)]).max() / np.abs(y - y[0]).max()
    return found


def start(earlier: RunResult, **changes: Any) -> dict[str, Any]:
    return {**FULL, "initial": {"result": str(earlier.path.parent), **changes}}


def test_full_order_continues_the_motion_and_the_heat(earlier: RunResult) -> None:
    scene = load(SWING, {**start(earlier, time=0.02), "time.end": 0.03})
    run = simulate(scene)
    assert max(difference(run, earlier, 20).values()) < 1e-9
    note, = (n for n in run.summary["information"] if n.startswith("starts from the state of"))
    assert note.endswith("at 0.02 s, with the mean rates since the stored step before")
    assert set(run.summary["note_kinds"]) <= {"stiff_in_bending"}


def test_a_reduced_run_projects_the_state_and_tells_the_error(
    earlier: RunResult, tmp_path: Path
) -> None:
    changes = {"reducer": GALERKIN, "time.end": 0.03, "training.end": 0.03}
    run = simulate(load(SWING, {**start(earlier, time=0.02), **changes}), out=tmp_path / "a")
    # trained on a run that starts from the same state
    assert max(difference(run, earlier, 20).values()) < 1e-4
    assert "onto the atoms, relative to the largest change: arm.elastic" in "".join(
        run.summary["information"])
    poor = {"reducer": {"use": "galerkin", "basis": {"use": "modal", "count": 1, "start": False}}}
    notes = simulate(load(SWING, {**start(earlier), **changes, **poor, "time.end": 0.002}))
    assert "initial" in notes.summary["note_kinds"]
    # a reduced result is a start, too, at its end with the rates of its last step
    again = simulate(load(SWING, {**start(run), "time.end": 0.01}))
    whole = simulate(load(SWING, {**start(earlier, time=0.02), "time.end": 0.04}))
    assert max(difference(again, whole, 30).values()) < 1e-3
    assert ", with its rates" in "".join(again.summary["information"])


def test_another_result_is_another_training_run(earlier: RunResult, tmp_path: Path) -> None:
    place = tmp_path / "state"
    scene = load(SWING, {**FULL, "time.end": 0.01, "training.end": 0.01, "reducer": GALERKIN,
                         "initial": {"result": str(place)}})
    errors = []
    for end in (0.01, 0.03):
        simulate(load(SWING, {**FULL, "time.end": end}), out=place / "of" / str(end))
        link = place / "result"
        link.unlink(missing_ok=True)
        link.symlink_to(place / "of" / str(end) / "result")
        full = simulate(scene.using({"reducer": "full"}))
        errors.append(measure_errors(full, simulate(scene)).worst["elastic"])
    assert max(errors) < 1e-3


@pytest.mark.parametrize(("changes", "initial", "message"), [
    ({}, {"time": 9.0}, "initial.time: give times within the run"),
    ({}, {"result": "nowhere"}, "initial.result: there is no result in"),
    ({"bodies.arm.mesh.divisions": [8, 2]}, {}, "initial.result: arm has another mesh"),
    ({"bodies.arm.fields": ["elastic"], "loads.sun": None}, {}, ""),
])
def test_what_does_not_fit_is_refused(
    earlier: RunResult, changes: dict[str, Any], initial: dict[str, Any], message: str
) -> None:
    scene = load(SWING, {**start(earlier, **initial), **changes, "time.end": 0.001})
    if not message:  # the result may have more fields than the run
        assert simulate(scene).status.ok
        return
    with pytest.raises(InputError) as refused:
        simulate(scene)
    assert message in str(refused.value)


def test_missing_fields_and_rigid_stages_are_refused(tmp_path: Path) -> None:
    cold = load(SWING, {**FULL, "time.end": 0.002, "bodies.arm.fields": ["elastic"],
                        "loads.sun": None})
    earlier = simulate(cold, out=tmp_path / "cold")
    with pytest.raises(InputError, match=r"the result has no arm.thermal with 33 unknowns"):
        simulate(load(SWING, start(earlier)))
    with pytest.raises(InputError, match="with a rigid stage the motion starts from the poses"):
        simulate(load(SLIDER, {"initial": {"result": str(tmp_path / "cold")}}))


def test_a_state_that_a_joint_does_not_fit_is_refused(tmp_path: Path) -> None:
    """The angle of a driven crank at the end of a run is not that at 0 s, where a run begins."""
    crank: dict[str, Any] = {
        "format": 1, "bodies": {"bar": {"use": "rigid", "mass": 1.0, "inertia": 0.1,
                                        "points": {"pin": [0, 0]}}},
        "joints": {"drive": {"use": "prescribed_motion", "of": "bar:pin", "x": 0.0, "y": 0.0,
                             "angle": {"use": "ramp", "end": 1.0, "final": 2.0}}},
        "time": {"end": 0.5, "step": 0.01}}
    simulate(load(crank), out=tmp_path)
    again = load(crank | {"initial": {"result": str(tmp_path)}})
    with pytest.raises(InputError, match="state at 0.5 s does not fit joint drive at 0 s.* 1 "):
        simulate(again)
    simulate(again.using({"joints.drive.angle.initial": 1.0, "joints.drive.angle.final": 3.0}))
