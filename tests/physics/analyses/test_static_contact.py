"""Static equilibrium with contact: two columns that are pressed on each other."""

from typing import Any

import pytest

from sparsemor import solve
from sparsemor.core.errors import InputError
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import scene_of
from tiers import quick

SIDE, PRESSURE, E, K = 0.1, 1e6, 1e9, 1e11
RUBS = {"use": "coulomb", "coefficient": 0.3, "critical_velocity": 1e-3}
STICKS = {"use": "stick", "coefficient": 0.3, "displacement": 1e-6}


def pressed(fields: list[str], friction: dict[str, Any] | None, lowered: float | None) -> Scene:
    """A column with a pressure on top, or lowered, on another one that stands."""
    def column(base: float, clamp: str, **options: Any) -> dict[str, Any]:
        return {"use": "flexible", "thickness": 0.01, "fields": fields,
                "material": {"E": E, "nu": 0.0, "rho": 1000.0},
                "mesh": {"use": "rectangle", "lower": [-SIDE / 2, base], "size": [SIDE, SIDE],
                         "divisions": [2, 2]},
                **({"reference": {"clamp": clamp}} if fields else {}), **options}

    return scene_of({
        "bodies": {"upper": column(0.0, "top", pose={"position": [0.0, -1e-6]}),
                   "lower": column(-SIDE, "bottom", frame="fixed")},
        "joints": {"guide": {"use": "prescribed_motion", "of": "upper:top", "x": 0.0,
                             "angle": 0.0, "y": lowered}},
        "contacts": {"sole": {
            "use": "polygonal", "between": ["upper:bottom", "lower:top"],
            "surfaces": "deformed" if fields else "rigid", "friction": friction,
            "normal": {"use": "elastic_foundation", "stiffness": K}}},
        "loads": {"press": {"use": "pressure", "on": ["upper:top"], "pressure": PRESSURE}},
        "time": {"end": 1.0, "step": 0.1}, "integrator": "bdf1"})


@pytest.mark.full
@pytest.mark.parametrize("friction", quick([None, RUBS], RUBS), ids=["smooth", "coulomb"])
def test_a_rigid_column_sinks_into_the_foundation(friction: dict[str, Any] | None) -> None:
    """By p / K; friction does nothing at rest."""
    found = solve(pressed([], friction, None), "static").result
    assert found is not None
    assert found.block("upper.rigid")[-1, 1] == pytest.approx(-PRESSURE / K, rel=1e-9)


@pytest.mark.full
@pytest.mark.parametrize("friction", quick([None, RUBS], RUBS), ids=["smooth", "coulomb"])
def test_two_elastic_columns_share_their_shortening(friction: dict[str, Any] | None) -> None:
    """Lowered by u, they press with p = u / (1 / K + 2 H / E)."""
    lowered = -1e-4
    scene = pressed(["elastic"], friction, lowered).using({"loads.press.pressure": 0.0})
    found = solve(scene, "static").result
    assert found is not None
    force = abs(found.block("guide.multiplier")[-1, 1])
    want = (1e-6 - lowered) / (1.0 / K + 2.0 * SIDE / E) * SIDE * 0.01
    assert force == pytest.approx(want, rel=1e-3)


def test_surfaces_that_stick_are_refused() -> None:
    with pytest.raises(InputError, match="depends on their history") as told:
        solve(pressed([], STICKS, None), "static")
    assert "contacts.sole.friction" in str(told.value)
