"""What numbers depend on is in the key of each cached product and checked before a resume."""

import importlib
import platform
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import meshio
import pytest
import threadpoolctl
from typer.testing import CliRunner

from sparsemor import InputError, load, simulate
from sparsemor.core.cli import app
from sparsemor.core.registry.hooks import hookimpl, new_manager
from sparsemor.core.scene import run_identity as identity
from sparsemor.core.scene.run_identity import FOLDERS, IRRELEVANT, REDUCTION, RELEVANT, Identity
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.stages_before_steps import prepared
from sparsemor.plugins.study.plan import StudyPlan

TINY = Path(__file__).parents[2] / "scenes" / "tiny.yaml"
SHORT: Mapping[str, Any] = {"time.end": 0.003}
Distribute = Callable[..., None]
BASIS = '''
import numpy as np

from sparsemor.core import Basis, BlockData, Dictionary


class Leading(Basis):
    """The first unit vectors."""

    needs_snapshots = False

    def build(self, data: BlockData) -> Dictionary:
        n = data.stiffness.shape[0]
        return Dictionary(np.eye(n, COUNT), np.zeros(n), ("unit",) * COUNT)
'''


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))


def test_every_key_of_a_scene_is_relevant_or_not() -> None:
    lists = [set(RELEVANT), set(IRRELEVANT), set(REDUCTION)]
    assert set.union(*lists) == set(Scene.model_fields)
    assert sum(map(len, lists)) == len(Scene.model_fields)


def training_of(scene: Scene) -> str:
    """Whether the cache has the training run of a scene; it has afterwards."""
    _, offline = prepared(scene, Cache(), new_manager())
    offline.snapshots("bar.thermal")
    return offline.products.used["training"]


@pytest.mark.full
def test_settings_without_influence_find_the_training_run() -> None:
    base = load(TINY, {**SHORT, "reducer": "galerkin"})
    assert training_of(base) == "miss"
    for change in (
        {"title": "Another"}, {"seed": 9}, {"check_stability": "off"},
        {"check_stability": "refuse"}, {"output.every": 3},
        {"probes": {"tip": {"body": "bar", "at": [0.5, 0.0]}}},
        {"reducer": {"use": "lspg"}},
    ):
        assert training_of(base.using(change)) == "hit", change
    assert training_of(base.using({"loads.heating.flux": 2e6})) == "miss"


def basis_of(module: str) -> str:
    """Whether the cache has the basis of this module; it has afterwards."""
    sys.modules.pop(module, None)
    importlib.invalidate_caches()
    scene = load(TINY, {**SHORT, "reducer": {"use": "galerkin", "basis": {"use": "leading"}}})
    _, offline = prepared(scene, Cache(), new_manager())
    offline.dictionary("bar.thermal", scene.reducer.basis)
    return offline.products.used["basis"]


@pytest.mark.full
def test_a_basis_of_a_plugin_that_changed_is_made_again(
    distribute: Distribute, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    distribute("leading", {"basis": {"leading": "leading_basis:Leading"}},
               leading_basis=BASIS.replace("COUNT", "2"))
    assert [basis_of("leading_basis"), basis_of("leading_basis")] == ["miss", "hit"]
    site = tmp_path / "site-leading"
    (site / "leading_basis.py").write_text(BASIS.replace("COUNT", "3"))
    assert [basis_of("leading_basis"), basis_of("leading_basis")] == ["miss", "hit"]
    metadata = site / "leading-1.0.dist-info" / "METADATA"
    metadata.write_text(metadata.read_text().replace("1.0", "1.1"))
    assert [basis_of("leading_basis"), basis_of("leading_basis")] == ["miss", "hit"]
    sys.modules.pop("leading_basis", None)


@pytest.mark.full
def test_a_changed_program_finds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    base = load(TINY, {**SHORT, "reducer": "galerkin"})
    assert [training_of(base), training_of(base)] == ["miss", "hit"]
    monkeypatch.setattr(identity, "code_digest", lambda: "other")
    assert training_of(base) == "miss"


def test_the_digest_of_the_program_reads_every_source() -> None:
    root = Path(identity.__file__).parents[2]
    known = {p for folder in FOLDERS for p in identity.sources(root / folder)}
    assert {p for p in root.rglob("*.py") if p.parent != root} <= known
    assert len(known) > 200


@pytest.mark.full
@pytest.mark.parametrize(("place", "runs", "studies"), [
    ("core", True, False), ("plugins", True, False), ("plugins/study", False, True),
    ("plugins/liang2026", False, False), ("core/cli", False, False)])
def test_no_run_depends_on_analysis_and_command_line(
    place: str, runs: bool, studies: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = Path(identity.__file__).parents[2]
    before = identity.code_digest.__wrapped__(), identity.folder_digest(root / "plugins/study")
    read, new = identity.sources, root / place / "new.py"
    monkeypatch.setattr(identity, "sources", lambda folder: [
        *read(folder), *([new] if new.is_relative_to(folder) else [])])
    after = identity.code_digest.__wrapped__(), identity.folder_digest(root / "plugins/study")
    assert (after[0] != before[0], after[1] != before[1]) == (runs, studies)


def test_a_study_is_another_one_after_its_plugin_changed(
    distribute: Distribute, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    distribute("leading", {"basis": {"leading": "leading_basis:Leading"}},
               leading_basis=BASIS.replace("COUNT", "2"))
    study = tmp_path / "some.yaml"
    study.write_text(
        f"format: 1\nscene: {TINY.name}\n"
        "set: {time.end: 0.003, reducer: {use: galerkin, basis: {use: leading}}}\n"
        "grid: {seed: [1, 2]}\n")
    (tmp_path / TINY.name).write_text(TINY.read_text())
    first = StudyPlan.read(study).digest
    assert StudyPlan.read(study).digest == first
    (tmp_path / "site-leading" / "leading_basis.py").write_text(BASIS.replace("COUNT", "4"))
    assert StudyPlan.read(study).digest != first
    sys.modules.pop("leading_basis", None)


class Stops:
    @hookimpl
    def on_step(self, step: int) -> None:
        if step == 2:
            raise RuntimeError("stopped")


def stop(scene: Scene, out: Path) -> None:
    with pytest.raises(RuntimeError, match="stopped"):
        simulate(scene, out=out, observers=[Stops()])


def with_mesh(folder: Path, height: float) -> Scene:
    """The tiny scene with its mesh in a file, `height` times as high."""
    mesh = load(TINY).bodies["bar"].mesh.build(folder)
    meshio.write_points_cells(
        folder / "bar.vtu", [[x, height * y, 0.0] for x, y in mesh.points],
        [("triangle", mesh.cells)])
    (folder / "tiny.yaml").write_text(TINY.read_text())
    left, right = ({"where": f"x {side}"} for side in ("< 1e-9", "> 0.499"))
    return load(folder / "tiny.yaml", {
        **SHORT, "reducer": "full", "bodies.bar.mesh": {"use": "file", "path": "bar.vtu"},
        "bodies.bar.sets.left": left, "bodies.bar.sets.right": right})


@pytest.mark.full
def test_a_run_is_not_continued_on_another_mesh(tmp_path: Path) -> None:
    scene = with_mesh(tmp_path, 1.0)
    stop(scene, tmp_path / "out")
    with_mesh(tmp_path, 0.2)
    with pytest.raises(InputError, match=r"cannot be resumed: since it was stopped, the file "
                                         r"bar.vtu has changed\. Start the run again, with "
                                         r"--force"):
        simulate(scene, out=tmp_path / "out", resume=True)
    with_mesh(tmp_path, 1.0)
    assert simulate(scene, out=tmp_path / "out", resume=True).status.ok


@pytest.mark.full
def test_a_run_is_not_continued_with_another_plugin_or_program(
    distribute: Distribute, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    distribute("leading", {"load": {"still": "still_load:Still"}}, still_load=(
        "from sparsemor.bodies.loads.body_forces import Gravity\n\n\nclass Still(Gravity):\n"
        '    """Gravity under another name."""\n'))
    scene = load(TINY, {**SHORT, "reducer": "full", "loads.gravity":
                        {"use": "still", "g": [0.0, -9.81]}})
    stop(scene, tmp_path / "out")
    metadata = tmp_path / "site-leading" / "leading-1.0.dist-info" / "METADATA"
    metadata.write_text(metadata.read_text().replace("1.0", "1.1"))
    with pytest.raises(
            InputError, match="plugin still_load was leading 1.0 and is leading 1.1"):
        simulate(scene, out=tmp_path / "out", resume=True)
    metadata.write_text(metadata.read_text().replace("1.1", "1.0"))
    with (tmp_path / "site-leading" / "still_load.py").open("a") as source:
        source.write("\n# changed\n")
    with pytest.raises(InputError, match=r"the code of plugin leading 1.0 has changed"):
        simulate(scene, out=tmp_path / "out", resume=True)
    sys.modules.pop("still_load", None)


@pytest.mark.parametrize(("attribute", "value", "words"), [
    ("code_digest", "other", "the code of sparsemor has changed"),
    ("library_versions", {"numpy": "1.0"}, "numpy was .* and is 1.0"),
    ("threads", 2, "the number of BLAS threads was 1 and is 2"),
])
def test_a_run_is_not_continued_by_another_program(
    attribute: str, value: Any, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = load(TINY, {**SHORT, "reducer": "full"})
    stop(scene, tmp_path / "out")
    assert Identity.from_scene(scene).changes(Identity.from_scene(scene).plain()) == []
    monkeypatch.setattr(identity, attribute, lambda: value)
    with pytest.raises(InputError, match=f"cannot be resumed: since it was stopped, .*{words}"):
        simulate(scene, out=tmp_path / "out", resume=True)


class Threads:
    """Threads of NumPy's and SciPy's BLAS libraries at each step. Those of other packages, which
    earlier tests may have loaded, can be built for one thread."""

    def __init__(self) -> None:
        self.seen: set[int] = set()

    @hookimpl
    def on_step(self) -> None:
        self.seen |= {lib["num_threads"] for lib in threadpoolctl.threadpool_info()
                      if lib["user_api"] == "blas"
                      and ("numpy" in lib["filepath"] or "scipy" in lib["filepath"])}


@pytest.mark.full
def test_a_run_that_is_continued_on_another_processor_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = load(TINY, {**SHORT, "reducer": "full"})
    stop(scene, tmp_path / "out")
    here = platform.machine()
    monkeypatch.setattr(platform, "machine", lambda: "another")
    found = simulate(scene, out=tmp_path / "out", resume=True).summary["information"]
    assert any(f"continued elsewhere: machine was {here} and is another" in n for n in found)


@pytest.mark.full
def test_a_comparison_keeps_no_run_of_another_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["compare", str(TINY), "--reducers", "full,galerkin", "--set", "time.end=0.003",
               "--no-charts", "--out", str(tmp_path / "out")]
    assert CliRunner().invoke(app, command).exit_code == 0
    kept = {p: p.stat().st_mtime_ns for p in (tmp_path / "out" / "full").rglob("*")}
    assert CliRunner().invoke(app, [*command, "--resume"]).exit_code == 0
    assert kept == {p: p.stat().st_mtime_ns for p in kept}
    monkeypatch.setattr(identity, "code_digest", lambda: "other")
    done = CliRunner().invoke(app, [*command, "--resume"])
    assert done.exit_code == 2
    assert "since it was computed, the code of sparsemor has chang" in done.stderr


@pytest.mark.full
def test_a_result_without_a_place_is_removed_when_the_process_ends() -> None:
    program = ("from sparsemor import load, simulate; r = simulate(load("
               f"{str(TINY)!r}, {{'time.end': 0.002, 'reducer': 'full'}})); "
               "print(r.path, r.path.is_dir())")
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True,
                           check=True).stdout.split()
    assert shown[1] == "True" and not Path(shown[0]).exists()


@pytest.mark.full
def test_runs_use_one_blas_thread_or_as_many_as_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SPARSEMOR_THREADS", raising=False)
    scene = load(TINY, {**SHORT, "reducer": "full"})
    for asked, expected in (("", 1), ("3", 3)):
        if asked:
            monkeypatch.setenv("SPARSEMOR_THREADS", asked)
        watch = Threads()
        with threadpoolctl.threadpool_limits(limits=2, user_api="blas"):
            result = simulate(scene, out=tmp_path / f"out{asked}", observers=[watch])
        assert watch.seen == {expected}
        for said in (result.summary["platform"], result.attributes["platform"]):
            assert said["threads"] == expected and said["blas"] and said["machine"]
    monkeypatch.setenv("SPARSEMOR_THREADS", "many")
    with pytest.raises(InputError, match="whole number of at least 1"):
        simulate(scene, out=tmp_path / "other")
