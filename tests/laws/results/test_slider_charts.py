"""Pictures of a rigid stage: forces of contacts, how far bodies move, and units that read well."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.terms.field_kinds import RIGID, THERMAL
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.layout import Block, Layout
from sparsemor.core.protocols.prescribed_motion import FrameHistory, Stage
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.style import unit
from sparsemor.plugins.charts.time_histories import (
    angles_figure,
    contact_forces_figure,
    moving_bodies,
    positions_figure,
)

TIMES = np.linspace(0.0, 3.75e-3, 51)


class Followed(RunResult):
    """A result that holds no more than how its bodies moved."""

    layout = Layout([Block("slider", RIGID, 3), Block("plate", THERMAL, 2)])
    times = TIMES
    scene: dict[str, Any] = {}

    def __init__(self, stage: Stage | None) -> None:
        self._stage = stage

    def block(self, name: str, steps: slice | IntArray = slice(None)) -> FloatArray:
        return np.linspace(0.0, 3.0, 51)[:, None] * np.ones(3)


def stage(contacts: tuple[str, ...] = ("sole",)) -> Stage:
    pose = np.stack([TIMES, -1.6e-7 * (1.0 - np.exp(-TIMES / 1e-4)), 3.2e-4 * TIMES / 3.75e-3],
                    axis=1)
    zero = np.zeros((51, 3))
    normal = np.where(TIMES > 0.0, 15.625, 0.0)
    history = {"normal": normal, "friction": 0.2 * normal, "power": 0.2 * normal,
               "length": np.full(51, 1.125e-3), "pressure": np.full(51, 22.2e6)}
    return Stage(
        TIMES, {"slider": FrameHistory(TIMES, pose, zero, zero),
                "plate": FrameHistory.standing(np.zeros(3), TIMES)},
        frozenset({"slider"}), {}, {name: history for name in contacts})


@pytest.mark.parametrize("largest,si,expected", [
    (3.75e-3, "s", (1e3, "ms")), (4.0, "s", (1.0, "s")), (4000.0, "s", (1.0, "s")),
    (-2.2e-7, "m", (1e9, "nm")), (6e-7, "m", (1e6, "µm")), (15.6, "N", (1.0, "N")),
    (18e3, "N", (1e-3, "kN")), (22.2e6, "Pa", (1e-6, "MPa")), (0.0, "m", (1.0, "m")),
    (1e15, "Pa", (1e-9, "GPa")), (1e-15, "m", (1e9, "nm")),
])
def test_units(largest: float, si: str, expected: tuple[float, str]) -> None:
    assert unit(largest, si) == expected


@pytest.mark.full
def test_forces_of_each_contact() -> None:
    figure = contact_forces_figure(Followed(stage(("sole", "guide"))).contacts())
    assert figure is not None
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["sole", "guide"]
    normal, friction = (np.asarray(line.get_ydata()) for line in figure.axes[0].lines)
    assert normal.shape == friction.shape == (50,)  # without the start, where nothing presses
    assert np.all(normal == 15.625)
    np.testing.assert_allclose(friction, 3.125)
    assert figure.axes[1].get_xlabel() == "time (ms)"
    assert figure.axes[0].get_ylim()[0] == 0.0


def test_only_moving_bodies_have_a_position() -> None:
    figure = positions_figure(moving_bodies(Followed(stage())))
    assert figure is not None
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "x moved (mm)", "y moved (nm)", "turned (µrad)"]
    for axes, last in zip(figure.axes, (3.75, -160.0, 320.0), strict=True):
        (line,) = axes.lines
        assert line.get_label() == "slider"
        drawn = np.asarray(line.get_ydata())
        assert drawn[0] == 0.0 and drawn[-1] == pytest.approx(last)


def test_nothing_to_draw() -> None:
    still = replace(stage(), moves=frozenset(), contacts={})
    assert contact_forces_figure(Followed(still).contacts()) is None
    assert positions_figure(moving_bodies(Followed(still))) is None
    start = replace(stage(), times=TIMES[:1], contacts={"sole": {"normal": np.zeros(1)}})
    assert contact_forces_figure(Followed(start).contacts()) is None
    assert positions_figure({"slider": (TIMES[:1], np.zeros((1, 3)))}) is None


def test_a_disk_that_follows_its_stage_has_the_stages_speed() -> None:
    """As Fig. 17: linear braking, 66.667 rad/s less 51.087 t; its frame has four coordinates."""
    t = np.linspace(0.0, 1.2, 1201)
    zero = np.zeros(1201)
    pose = np.stack([zero, zero, zero, 66.667 * t - 0.5 * 51.087 * t**2], axis=1)
    rate = np.stack([zero, zero, zero, 66.667 - 51.087 * t], axis=1)
    disk = FrameHistory(t, pose, rate, 0.0 * rate)
    run = Followed(Stage(t, {"disk": disk}, frozenset({"disk"}), {}, {}))
    run.layout = Layout([Block("disk", THERMAL, 2)])
    figure = angles_figure(run, {}, "full")
    assert figure is not None
    angle, speed = (np.asarray(axes.lines[0].get_ydata()) for axes in figure.axes)
    assert angle[-1] == pytest.approx(43.22, abs=0.01)
    assert speed[-1] == pytest.approx(5.36, abs=0.01)
    assert figure.axes[1].get_ylabel() == "angular speed (rad/s)"
    moved = positions_figure(moving_bodies(run))
    assert moved is not None and [a.get_ylabel() for a in moved.axes] == ["turned (rad)"]
