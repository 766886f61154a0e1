"""What a run will hold is told from the counts of its meshes, before anything is meshed."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from sparsemor import load
from sparsemor.bodies.fem.integrals import capacity
from sparsemor.bodies.mesh.generators.disk import Disk
from sparsemor.bodies.mesh.generators.pad import Pad
from sparsemor.core.cli import app
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry
from sparsemor.core.simulation.memory import limits as memory
from sparsemor.core.simulation.memory.estimate import precheck_memory
from sparsemor.core.simulation.validation import checked_model

SCENES = Path(__file__).parents[2] / "scenes"
MESHES: list[dict[str, Any]] = [
    {"use": "disk"}, {"use": "disk", "refine": 1.4, "probes": [0.05]},
    {"use": "disk", "refine": 0.3}, {"use": "pad"}, {"use": "pad", "refine": 1.9},
    {"use": "block", "size": [1, 2, 3], "divisions": [3, 4, 5]},
    {"use": "block", "size": [1, 2, 3], "divisions": [3, 4, 5], "refine": 1.6},
    {"use": "rectangle", "size": [2, 1], "divisions": [7, 4]},
    {"use": "link"}, {"use": "link", "elements": 320}, {"use": "link", "elements": 5120},
    {"use": "unstructured", "size": [2, 1], "divisions": [8, 4], "elements": 80},
    {"use": "unstructured", "size": [2, 1], "divisions": [8, 4], "elements": 80, "refine": 2},
]


def mesh_of(options: dict[str, Any]) -> Any:
    rest = {k: v for k, v in options.items() if k != "use"}
    return Registry().get("mesh", options["use"]).model_validate(rest)


@pytest.mark.parametrize("options", [
    pytest.param(o, marks=[pytest.mark.full] * ("refine" in o and "probes" in o)) for o in MESHES],
    ids=lambda o: json.dumps(o))
def test_generators_know_their_size(options: dict[str, Any]) -> None:
    plugin = mesh_of(options)
    told, mesh = plugin.expected(), plugin.build(Path())
    assert (told.points, told.cells, told.dimension) == (
        len(mesh.points), len(mesh.cells), mesh.dimension)
    nnz = capacity(mesh, 1.0, 1.0).nnz
    if told.dimension == 2:  # two more a hole, two less without one
        assert abs(nnz - told.pairs) <= 2
    else:  # the boundary's facets come on top
        assert told.pairs < nnz <= 1.35 * told.pairs


def test_what_cannot_fit_is_refused_before_it_is_meshed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def meshed(*_: Any) -> Any:
        raise AssertionError("this would take minutes and all memory there is")

    for mesh in (Disk, Pad):
        monkeypatch.setattr(mesh, "build", meshed)
    monkeypatch.setenv(memory.LIMIT, "4")
    out, cache = tmp_path / "out", tmp_path / "cache"
    monkeypatch.setenv("SPARSEMOR_CACHE", str(cache))
    for command in (["run", "brake_disk", "--out", str(out)], ["validate", "brake_disk"]):
        before = memory.peak()
        done = CliRunner().invoke(app, [*command, "--set", "bodies.disk.mesh.refine=20", "--json"])
        assert done.exit_code == 2, done.output
        (said,) = json.loads(done.stdout)["errors"]
        assert "this run would hold about" in said and "4 GB are there" in said
        assert "coarser mesh" in said
        assert memory.peak() - before < 5e7
    assert not out.exists() and not cache.exists()


@pytest.mark.parametrize(("reducer", "what"), [
    ("full", "the mesh of disk, 82752000 cells"),
    ({"use": "galerkin", "basis": {"use": "pod", "count": 3}}, "the operators of disk"),
])
def test_the_counts_that_decide_are_told(reducer: Any, what: str) -> None:
    told = precheck_memory(load("brake_disk", {"bodies.disk.mesh.refine": 20, "reducer": reducer}))
    assert told is not None and not told.exact
    assert what in [item.what for item in told.phases[told.largest]]
    assert told.total > 1e11


def test_factors_count_where_a_solver_must_have_them() -> None:
    sizes = {}
    for solver in ("splu", "auto", "cg"):
        told = precheck_memory(load("brake_disk", {
            "bodies.disk.mesh.refine": 6, "reducer": "full", "linear_solver": solver}))
        assert told is not None
        sizes[solver] = told.total - told.base
    assert sizes["splu"] > 1.1 * sizes["auto"] and sizes["auto"] == sizes["cg"]


def test_bodies_that_do_not_know_their_size_are_left_to_the_later_count() -> None:
    scene = load("double_pendulum", {"bodies.link1.mesh": {"use": "file", "path": "no.msh"}})
    told = precheck_memory(scene)
    assert told is not None
    assert all("link1" not in i.what for items in told.phases.values() for i in items)
    rigid = load(SCENES.parent.parent / "docs" / "examples" / "rigid_pendulum.yaml")
    assert precheck_memory(rigid) is None


@pytest.mark.full
def test_a_wrong_end_of_the_training_is_told_once() -> None:
    scene = load("double_pendulum", {"training.end": 1.00005, "bodies.link1.mesh.elements": 1280})
    with pytest.raises(InputError) as error:
        checked_model(scene)
    assert [f.key for f in error.value.faults] == ["training.end"]
