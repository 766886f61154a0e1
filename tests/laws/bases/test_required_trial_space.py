"""Bases that a packaged scene cannot run on are refused before the first step, and its own and
other right ones are not."""

from pathlib import Path

import numpy as np
import pytest

from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.stages_before_steps import prepared_run


@pytest.mark.full
@np.errstate(all="ignore")
def test_short_steps_need_impulse_responses(tmp_path: Path) -> None:
    """Static modes hold every static response, and 0.05 % of the motion is left out in steps of
    1 ms, but 1.4 % in steps of 0.1 ms, which resolve waves in the link; vibration modes hold it."""
    cache, coarse = Cache(tmp_path), {f"bodies.link{i}.mesh.elements": 320 for i in (1, 2)}
    static, modes = "static", {"use": "dictionary", "orthonormal": True, "bases": [
        "static", {"use": "modal", "count": 5}]}

    def noted(step: float, basis: object) -> str:
        scene = load("double_pendulum", {
            **coarse, "time.step": step, "time.end": 30 * step, "check_stability": "off",
            "loads": {"gravity": {"use": "gravity", "g": [0.0, -9.81]}},
            "reducer": {"use": "galerkin", "basis": basis, "bases": {"*.thermal": "static"}}})
        run = prepared_run(scene, cache, new_manager([]))[0]
        return " ".join(n.text for n in run.notes if "link2.elastic" in n.text)

    assert not noted(1e-3, static) and not noted(1e-4, modes)
    said = noted(1e-4, static)
    assert "cannot represent the impulse response to" in said
    assert 0.014 < float(said.split("projection error ")[1].split()[0]) < 0.06
