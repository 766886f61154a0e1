"""Temperatures that the scene gives are those of the stored step, in results and exports."""

import signal
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from sparsemor.core.registry.hooks import hookimpl
from sparsemor.core.results.run_result import RunResult, open_result
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.status import SolveFailed
from sparsemor.core.testing.in_memory_run import scene_of
from sparsemor.plugins.export import export
from tiers import quick

RAMP = {"use": "ramp", "end": 1.0, "initial": 300.0, "final": 400.0}
GALERKIN = {"use": "galerkin", "basis": {"use": "pod", "count": 4}}


def slab(**changes: Any) -> Scene:
    return scene_of({
        "bodies": {"slab": {
            "use": "flexible", "frame": "fixed", "fields": ["thermal"], "thickness": 0.02,
            "mesh": {"use": "rectangle", "size": [0.1, 0.01], "divisions": [8, 1]},
            "material": {"rho": 1000, "k": 20, "c": 500}, "initial_temperature": 300.0}},
        "joints": {
            "hot": {"use": "prescribed_temperature", "on": ["slab:left"], "temperature": RAMP},
            "cold": {"use": "prescribed_temperature", "on": ["slab:right"], "temperature": 290.0}},
        "time": {"end": 1.0, "step": 0.1}, "training": {"end": 1.0}, **changes})


@pytest.mark.parametrize("reducer", quick(["full", GALERKIN], "full"), ids=["full", "galerkin"])
def test_given_temperatures_follow_their_functions(tmp_path: Path, reducer: Any) -> None:
    scene = slab(reducer=reducer, check_stability="off")
    simulate(scene, out=tmp_path / "run", cache=Cache(tmp_path / "cache"))
    run = open_result(tmp_path / "run")
    held(run, [300.0 + 10.0 * n for n in range(11)])
    done = export(run, tmp_path / "files", "vtu", at=[0.0, 0.5])
    for file, step in zip(sorted(done.folder.rglob("*.vtu")), (0, 5), strict=True):
        told = meshio.read(file).point_data["temperature"]
        np.testing.assert_array_equal(told, run.nodal_temperature("slab", step))


def held(run: RunResult, hot: list[float]) -> None:
    x = run.points("slab")[:, 0]
    for step, want in enumerate(hot):
        T = run.nodal_temperature("slab", step)
        np.testing.assert_allclose(T[x == 0.0], want, rtol=1e-14)
        assert T[x == 0.0].max() == T[x == 0.0].min()
        np.testing.assert_array_equal(T[x == x.max()], 290.0)
        assert T[(x > 0.0) & (x < x.max())].max() < want + 0.1
    np.testing.assert_array_equal(
        run.nodal_temperature("slab", -1), run.nodal_temperature("slab", len(hot) - 1))


@pytest.mark.full
def test_a_resumed_run_stores_them_on(tmp_path: Path) -> None:
    class Stop:
        @hookimpl
        def on_step(self, step: int) -> None:
            if step == 4:
                signal.raise_signal(signal.SIGINT)

    with pytest.raises(SolveFailed, match="interrupted"):
        simulate(slab(), out=tmp_path / "run", observers=[Stop()], cache=Cache(tmp_path / "cache"))
    simulate(slab(), out=tmp_path / "run", resume=True, cache=Cache(tmp_path / "cache"))
    held(open_result(tmp_path / "run"), [300.0 + 10.0 * n for n in range(11)])
