"""Runs whose displacements leave the body end as `diverged`, with the likely cause."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import SolveFailed, load_model, reduce, simulate
from sparsemor.core.model.assembly import assemble
from sparsemor.core.simulation.blow_up import WITHIN, Extents, Limits
from sparsemor.core.testing.in_memory_run import scene_of

BAR: dict[str, Any] = {
    "use": "flexible", "thickness": 0.01, "fields": ["elastic"], "reference": {"clamp": "left"},
    "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [0.4, 0.1], "divisions": [6, 2]},
    "material": {"E": 1e6, "nu": 0.3, "rho": 1000.0}}


def spinning(rate: float) -> Any:
    """A rubber bar that a drive turns; its lowest frequency as a cantilever is about 19 rad/s."""
    drive = {"use": "prescribed_motion", "of": "bar:left", "x": 0.0, "y": 0.0,
             "angle": {"use": "table", "times": [0.0, 10.0], "values": [0.0, 10.0 * rate]}}
    return scene_of({
        "bodies": {"bar": {**BAR, "pose": {"spin": rate}}}, "joints": {"drive": drive},
        "loads": {"weight": {"use": "gravity"}},
        "time": {"end": 1.0, "step": 2e-3}, "integrator": "bdf2"})


@pytest.mark.full
def test_a_bar_that_spins_faster_than_it_vibrates_diverges_by_its_spin() -> None:
    """Linear strains have no stiffness by spin: K - w^2 M is indefinite, and u grows for ever."""
    with pytest.raises(SolveFailed) as failure:
        simulate(spinning(200.0))
    assert failure.value.status.value == "diverged" and failure.value.block == "bar.elastic"
    assert "displacements of" in failure.value.detail
    assert "the body turns at 200 rad/s" in str(failure.value)
    assert "strains: nonlinear" in str(failure.value)


def test_sudden_growth_beyond_the_body_is_suspected_and_slow_growth_is_not() -> None:
    scene = spinning(1.0)
    model = assemble(scene)
    extents = Extents.from_model(model, model.layout, {})
    at = model.layout["bar.elastic"]

    def shape(size: float) -> Any:
        x = model.x0.copy()
        x[at] = size
        return x

    assert extents.exceeded(extents.sizes(shape(0.69)[None])[0]) is None
    large = extents.exceeded(extents.sizes(shape(0.7)[None])[0])
    assert large is not None  # twice the diagonal of the free nodes
    assert large.diagonal == pytest.approx(np.hypot(0.4 * 5 / 6, 0.1))
    for sizes, suspected in (([1e-5] * WITHIN + [0.11], True), ([2e-3] * WITHIN + [0.11], False),
                             ([1e-5] * WITHIN + [0.09], False), ([0.0] * WITHIN + [0.11], False)):
        x = np.stack([shape(s) for s in sizes])
        one_by_one, at_once = Limits(extents), Limits(extents).found(x)
        found = [one_by_one.found(row[None]).get(0, (None, None)) for row in x]
        for of in (found, [at_once.get(i, (None, None)) for i in range(len(x))]):
            assert [sudden is not None for _, sudden in of] == [*[False] * WITHIN, suspected]


def heated(power: float) -> Any:
    """A plate of 1e-3 K m3/J by 50 s of heat flux."""
    return scene_of({
        "bodies": {"plate": {
            "use": "flexible", "thickness": 0.01, "fields": ["thermal"],
            "mesh": {"use": "rectangle", "lower": [0.0, 0.0], "size": [0.1, 0.1],
                     "divisions": [2, 2]},
            "material": {"k": 50.0, "rho": 1000.0, "c": 1000.0}, "initial_temperature": 300.0}},
        "loads": {"heat": {"use": "heat_flux", "on": ["plate:left"], "flux": power}},
        "time": {"end": 50.0, "step": 1.0}, "integrator": "bdf2"})


@pytest.mark.full
def test_temperatures_beyond_any_material_diverge() -> None:
    """1e10 W/m2 on 0.1 m of 1e6 J/(m3 K): 1e5 K/s in the mean, 1e6 K within 10 s; a thousandth of
    it is hot, and done."""
    with pytest.raises(SolveFailed) as failure:
        simulate(heated(1e10))
    assert failure.value.status.value == "diverged" and failure.value.block == "plate.thermal"
    assert "temperatures of" in failure.value.detail and failure.value.time <= 11.0
    assert "half the step does not help: check the heat of loads" in str(failure.value)
    assert simulate(heated(1e7)).status.ok


@pytest.mark.full
@pytest.mark.parametrize("fields", [False, pytest.param(True, marks=pytest.mark.full)])
@pytest.mark.parametrize("field", ["thermal", "elastic"])
def test_a_model_from_a_file_diverges_as_in_memory(
    field: str, fields: bool, tmp_path: Path
) -> None:
    """A file holds the extents of its bodies, by as many rows of the atoms as there are atoms."""
    pulled = {
        "loads": {"pull": {"use": "traction", "on": ["plate:right"], "traction": [0.0, 1e4],
                           "factor": {"use": "constant", "level": 1.0}}},
        "bodies.plate.fields": ["elastic"], "bodies.plate.frame": "fixed",
        "bodies.plate.reference": {"clamp": "left"},
        "bodies.plate.material": {"E": 1e9, "nu": 0.3, "rho": 1000.0}}
    key, harmless, beyond, noun = ("loads.heat.flux", 1e7, 1e10, "temperatures of") if (
        field == "thermal") else ("loads.pull.factor.level", 2.0, 1e6, "displacements of")
    basis = {"reducer": {"use": "galerkin", "basis": {"use": "modal", "count": 4}}}
    model = reduce(heated(1e6).using(basis | (pulled if field == "elastic" else {})))
    model.save(tmp_path / "plate.model", fields=fields)
    read = load_model(tmp_path / "plate.model")
    read.save(tmp_path / "again.model")
    found = []
    for one in (model, read, load_model(tmp_path / "again.model")):
        assert one.run({key: harmless}).status.ok
        with pytest.raises(SolveFailed, match=noun) as failure:
            one.run({key: beyond})
        assert failure.value.status.value == "diverged"
        assert failure.value.block == f"plate.{field}"
        found.append(failure.value.time)
    assert max(found) <= found[0] + 1.0  # at most a step later
