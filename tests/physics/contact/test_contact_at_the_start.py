"""Surfaces that touch and are pressed together: integrators of second order at the start."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import InputError, load, simulate
from sparsemor.core.scene.scene import Scene
from tiers import quick

SCENES = Path(__file__).parents[2] / "scenes"


def brake(integrator: str, **changes: Any) -> Scene:
    return load(SCENES / "small_brake.yaml", {
        "integrator": integrator, "reducer": "full", "time.end": 0.005, **changes})


@pytest.mark.parametrize("integrator", quick(["bdf2", "generalized_alpha"], "bdf2"))
def test_free_flight_through_the_other_surface_is_refused(here: Path, integrator: str) -> None:
    with pytest.raises(InputError, match="last only until the contact is compressed") as found:
        simulate(brake(integrator))
    (fault,) = found.value.faults
    assert fault.key == "integrator"
    # 18 kN on a pad of some 44 g
    assert "4.09e+05 m/s2" in fault.message and "went 0.2 m below the surface" in fault.message
    assert "rigid_stage: {overrides: {integrator: bdf1}}" in fault.message


@pytest.mark.full
@pytest.mark.parametrize("integrator", ["bdf2", "generalized_alpha"])
def test_what_the_refusal_advises_runs(here: Path, integrator: str) -> None:
    def end(**changes: Any) -> float:
        run = simulate(brake(integrator, **changes))
        return float(np.abs(run.block("pad.elastic")[-1]).max())

    want = float(np.abs(simulate(brake("bdf1")).block("pad.elastic")[-1]).max())
    ramp = {"use": "ramp", "end": 0.002, "final": 18000.0}
    assert end(**{"loads.press.force": ramp}) == pytest.approx(want, rel=0.1)
    assert end(**{"rigid_stage.overrides": {"integrator": "bdf1"}}) == pytest.approx(want, rel=0.1)


@pytest.mark.full
def test_a_short_step_is_not_refused(here: Path) -> None:
    """Within 1e-5 s the pad moves 20 um, less than half a facet."""
    scene = brake("bdf2", **{"time.step": 1e-5, "time.end": 3e-5})
    assert simulate(scene).status.ok
