"""Surfaces that touch and are pressed together: integrators of second order at the start."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import resolved_start
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.rigid_stage import rigid_scene

SCENES = Path(__file__).parents[2] / "scenes"


def brake(integrator: str, **changes: Any) -> Scene:
    return load(SCENES / "small_brake.yaml", {
        "integrator": integrator, "reducer": "full", "time.end": 0.005, **changes})


@pytest.mark.full
@pytest.mark.parametrize("integrator", ["bdf2", "generalized_alpha"])
def test_free_flight_through_the_other_surface_is_left_out(here: Path, integrator: str) -> None:
    """18 kN on a pad of some 44 g; after the contact is compressed all integrators agree."""
    def end(integrator: str, **changes: Any) -> float:
        run = simulate(brake(integrator, **changes))
        return float(np.abs(run.block("pad.elastic")[-1]).max())

    want, run = end("bdf1"), simulate(brake(integrator))
    (note,) = [n for n in run.summary["information"] if n.startswith("the accelerations")]
    assert "up to 4.09e+05 m/s2" in note and "the first step begins without them" in note
    assert float(np.abs(run.block("pad.elastic")[-1]).max()) == pytest.approx(want, rel=0.1)
    ramp = {"use": "ramp", "end": 0.002, "final": 18000.0}
    assert end(integrator, **{"loads.press.force": ramp}) == pytest.approx(want, rel=0.1)


@pytest.mark.full
def test_steps_that_resolve_the_free_flight_keep_their_accelerations(here: Path) -> None:
    rigid = rigid_scene(brake("bdf2"))
    model = assemble(rigid)
    start = resolved_start(model, rigid.integrator, 1e-3)
    assert start.dropped > 1e5 and not start.state.a.any()
    for h, integrator in ((1e-5, rigid.integrator), (1e-3, brake("bdf1").integrator)):
        kept = resolved_start(model, integrator, h)
        assert kept.dropped == 0.0 and np.abs(kept.state.a).max() == start.dropped


@pytest.mark.full
def test_a_short_step_runs(here: Path) -> None:
    """Within 1e-5 s the pad moves 20 um, less than half a facet."""
    scene = brake("bdf2", **{"time.step": 1e-5, "time.end": 3e-5})
    assert simulate(scene).status.ok
