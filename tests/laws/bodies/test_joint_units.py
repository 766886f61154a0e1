"""Joint forces in a result: each multiplier has its own name and unit."""

from pathlib import Path
from typing import Any

import pytest

from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.validation import checked_model

SCENES = Path(__file__).parents[2] / "scenes"
TINY = SCENES / "tiny.yaml"


def joint(result: RunResult, name: str) -> tuple[list[str], str]:
    found = result.to_xarray()[f"{name}.multiplier"]
    return found[found.dims[1]].to_numpy().tolist(), str(found.attrs["units"])


@pytest.mark.full
@pytest.mark.parametrize("options, names, units", [
    ({"use": "revolute", "between": ["ground", "bar:left"]}, ["force x", "force y"], "N, N"),
    ({"use": "fixed", "between": ["ground", "bar:left"]}, ["force x", "force y", "moment"],
     "N, N, N m"),
    ({"use": "prescribed_motion", "of": "bar:left", "x": 0.0, "angle": 0.0},
     ["force x", "moment"], "N, N m"),
])
def test_a_joint_in_the_plane(options: dict[str, Any], names, units, here):
    result = simulate(load(TINY, {"joints": {"pin": options}, "time.end": 0.001}))
    assert joint(result, "pin") == (names, units)


def test_joints_in_space_name_every_multiplier():
    model = checked_model(load(SCENES / "everything_in_space.yaml"))
    found = model.multiplier_components
    for block in model.layout:
        if block.name in found:
            names = [name for name, _ in found[block.name]]
            assert len(names) == len(set(names)) == block.size
    ball = found["ball.multiplier"]
    assert ball == (("force x", "N"), ("force y", "N"), ("force z", "N"))
    assert [u for _, u in found["rail.multiplier"]] == ["N", "N", "N m"]  # it turns about z alone
    assert [u for _, u in found["tube.multiplier"]] == ["N", "N", "N m", "N m"]
