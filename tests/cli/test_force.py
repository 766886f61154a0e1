"""Files of a user beside and inside what this program wrote: commands with --force, and the cache,
leave them alone. The first ten assertions are the lines of an attack that nine of ten times removed
them."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from sparsemor import load, simulate
from sparsemor.core.cli import app
from sparsemor.core.results.files.written_files import LISTING
from sparsemor.core.simulation.cache import Cache

TINY = (Path(__file__).parents[1] / "scenes" / "tiny.yaml").read_text(encoding="utf-8")
SHORT = ("--set", "time.end=0.003", "--set", "training.end=0.003", "--quiet")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))
    Path("tiny.yaml").write_text(TINY, encoding="utf-8")


def sparsemor(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, list(words))
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.stderr


def write(*names: str) -> None:
    for name in names:
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text("mine", encoding="utf-8")


def kept(*names: str) -> bool:
    return all(Path(n).read_text(encoding="utf-8") == "mine" for n in names)


@pytest.mark.full
def test_files_beside_a_result_stay() -> None:
    assert sparsemor("run", "tiny.yaml", "--out", "a", *SHORT)[0] == 0
    write("a/notes.txt", "a/mine/plot.py", "a/result/notes.txt", "a/errors.csv",
          "a/angles.png")
    before = Path("a/result/header.json").read_bytes()
    assert sparsemor("run", "tiny.yaml", "--out", "a", "--force", *SHORT)[0] == 0
    assert kept("a/notes.txt", "a/mine/plot.py", "a/result/notes.txt")
    assert Path("a/result/header.json").read_bytes() != before
    assert not Path("a/.replaced").exists()
    code, error = sparsemor("compare", "tiny.yaml", "--out", "a", "--force", *SHORT)
    assert code == 2 and error == (
        "--out: a/errors.csv and 1 more: not written by sparsemor, or changed since, and "
        "therefore not replaced: move it away, or choose another --out\n")
    assert kept("a/errors.csv", "a/angles.png") and not Path("a/full").exists()


@pytest.mark.full
def test_a_folder_that_only_contains_a_result_is_none() -> None:
    write("thesis/ch1.tex", "m.csv")
    assert sparsemor("run", "tiny.yaml", "--out", "p/run", *SHORT)[0] == 0
    write("p/paper.tex")
    for command, out in (("run", "."), ("run", "p"), ("compare", "p"), ("study", "p")):
        more = ("--reducers", "full,galerkin") if command == "compare" else ()
        scene = "tiny.yaml"
        if command == "study":
            scene = "study.yaml"
            Path(scene).write_text(json.dumps(
                {"scene": "tiny.yaml", "grid": {"time.step": [1e-3]}}), encoding="utf-8")
        quiet = ("--quiet",) if command == "study" else SHORT
        code, error = sparsemor(command, scene, "--out", out, "--force", *more, *quiet)
        assert code == 2 and "--force replaces" in error, error
    assert sparsemor("run", "tiny.yaml", "--set", "loads.heating.flux=1e300", "--out", "p",
                     "--force", *SHORT)[0] == 2
    assert kept("thesis/ch1.tex", "m.csv", "p/paper.tex") and Path("p/run/result").is_dir()
    assert Path("tiny.yaml").read_text(encoding="utf-8") == TINY


@pytest.mark.full
@pytest.mark.parametrize(("change", "code"), [
    ("loads.heating.flux=1e300", 1), ("time.end=0.0155", 2), ("bodies.bar.material.E=-1", 2)])
def test_files_stay_where_the_new_run_fails(change: str, code: int) -> None:
    assert sparsemor("run", "tiny.yaml", "--out", "a", *SHORT)[0] == 0
    write("a/paper.tex", "a/result/time/notes.txt")
    before = Path("a/result/header.json").read_bytes()
    short = SHORT if "time.end" not in change else SHORT[2:]
    assert sparsemor(
        "run", "tiny.yaml", "--out", "a", "--force", *short, "--set", change)[0] == code
    assert kept("a/paper.tex", "a/result/time/notes.txt")
    if code == 2:  # the earlier result is back
        assert Path("a/result/header.json").read_bytes() == before


@pytest.mark.full
def test_what_belongs_to_a_result_goes_with_it() -> None:
    run = ("run", "tiny.yaml", "--out", "a", *SHORT)
    compare = ("compare", "tiny.yaml", "--out", "a", "--no-charts", "--force",
               "--reducers", "full,galerkin", *SHORT)
    assert sparsemor(*run)[0] == 0 and sparsemor("export", "a", "--quiet")[0] == 0
    write("a/vtu/notes.txt", "a/notes.txt")
    assert sparsemor(*compare)[0] == 0
    assert {p.name for p in Path("a").iterdir()} == {
        LISTING, "errors.csv", "start_up.csv", "error_over_time.csv", "full", "galerkin",
        "notes.txt", "vtu"}
    assert {p.name for p in Path("a/vtu").iterdir()} == {"notes.txt"}
    write("a/full/notes.txt")
    Path("a/errors.csv").write_text("mine", encoding="utf-8")
    assert sparsemor(*compare)[0] == 2 and kept("a/errors.csv")
    Path("a/errors.csv").unlink()
    assert sparsemor(*run, "--force")[0] == 0
    assert {p.relative_to("a").as_posix() for p in Path("a").rglob("*.*")} >= {
        "full/notes.txt", "notes.txt", "vtu/notes.txt"}
    assert kept("a/full/notes.txt", "a/notes.txt", "a/vtu/notes.txt")
    assert {p.name for p in Path("a").iterdir()} == {
        "result", "result.checkpoint", "full", "vtu", "notes.txt"}


@pytest.mark.full
@pytest.mark.parametrize("command", ["reduce", "advise"])
def test_commands_that_write_a_file_replace_their_own_only(command: str) -> None:
    galerkin = ("--set", "reducer={use: galerkin, basis: {use: pod, count: 3}}")
    words = (command, "tiny.yaml", *SHORT, *(galerkin if command == "reduce" else ()))
    write("thesis.tex")
    Path("folder").mkdir()
    for out, said in (("thesis.tex", "exists"), ("folder", "is a folder"), ("", "empty"),
                      ("no/file", "there is no folder"), ("thesis.tex", "not written by sparsemor"),
                      ("folder", "is a folder")):
        force = ("--force",) if said.startswith(("not", "is")) else ()
        code, error = sparsemor(*words, "--out", out, *force)
        assert code == 2 and said in error and "Traceback" not in error, error
    assert kept("thesis.tex") and not list(Path("folder").iterdir())
    assert sparsemor(*words, "--out", "made")[0] == 0
    assert sparsemor(*words, "--out", "made")[0] == 2
    assert sparsemor(*words, "--out", "made", "--force")[0] == 0
    with Path("made").open("ab") as file:
        file.write(b"# mine\n")
    code, error = sparsemor(*words, "--out", "made", "--force")
    assert code == 2 and "changed since" in error
    assert Path("made").read_bytes().endswith(b"# mine\n")


@pytest.mark.parametrize("command", [
    ("run", "tiny.yaml"), ("compare", "tiny.yaml"), ("reduce", "tiny.yaml"), ("study", "s.yaml"),
    ("advise", "tiny.yaml"), ("stability", "tiny.yaml"), ("reproduce",), ("export", "a"),
    ("pictures", "a"), ("animate", "a"), ("new-plugin", "x", "--kind", "basis")])
def test_an_empty_out_is_refused(command: tuple[str, ...]) -> None:
    """It would be the working directory: of a shell, a variable that is not set."""
    code, error = sparsemor(*command, "--out", "")
    assert code == 2 and "empty" in error
    assert [p.name for p in Path().iterdir()] == ["tiny.yaml"]


@pytest.mark.full
def test_pictures_and_animations_replace_their_own_only() -> None:
    simulate(load("tiny.yaml", {"time.end": 0.003}), out="a")
    write("a/animation.gif", "mine.gif", "p/angles.png", "p/positions.png", "p/displacement.png")
    for words in (("animate", "a"), ("animate", "a", "--out", "mine.gif"),
                  ("pictures", "a", "--out", "p")):
        code, error = sparsemor(*words)
        assert code == 2 and "not written by sparsemor" in error, (words, error)
    assert kept("a/animation.gif", "mine.gif", "p/angles.png", "p/positions.png",
                "p/displacement.png")
    Path("a/animation.gif").unlink()
    for _ in range(2):  # and again over their own
        assert sparsemor("animate", "a", "--frames", "2", "--quiet")[0] == 0
        assert sparsemor("pictures", "a", "--quiet")[0] == 0


def test_the_cache_removes_marked_entries_only() -> None:
    write("cache/thesis/ch1.tex", "cache/notes.txt", "cache/basis/k/notes.txt")
    write("cache/web/app/manifest.json", "cache/machine_code/0/thesis.tex")
    forged = {"files": {"x": ["../../../tiny.yaml", 1]}, "checksum": 1}
    Path("cache/basis/f").mkdir()
    Path("cache/basis/f/manifest.json").write_text(json.dumps(forged), encoding="utf-8")
    cache = Cache()
    cache.get_or_make("basis", "k", lambda: {"x": np.ones(3)})
    cache.get_or_make("basis", "l", lambda: {"x": np.ones(3)})
    write("cache/basis/l/mine.npy")
    Path("cache/machine_code/0/f-1.py311.nbi").write_bytes(b"1")
    assert {(e.kind, e.key) for e in cache.entries()} == {("basis", "l"), ("machine_code", "0")}
    code, _ = sparsemor("cache", "--limit", "0")
    assert code == 0 and not cache.entries()
    assert sparsemor("cache", "--clear")[0] == 0 and cache.clear() == 0
    assert kept("cache/thesis/ch1.tex", "cache/notes.txt", "cache/basis/k/notes.txt",
                "cache/web/app/manifest.json", "cache/machine_code/0/thesis.tex",
                "cache/basis/l/mine.npy")
    assert {p.name for p in Path("cache/machine_code/0").iterdir()} == {"thesis.tex"}
    assert {p.name for p in Path("cache/basis/l").iterdir()} == {"mine.npy"}
    assert Path("cache/basis/f/manifest.json").exists()


def test_entries_that_cannot_be_read_or_removed_are_counted(
    monkeypatch: pytest.MonkeyPatch
) -> None:
    """As another user's are, and on a file system that is read-only."""
    cache = Cache()
    for key in "abc":
        cache.get_or_make("basis", key, lambda: {"x": np.ones(3)})
    read, unlink = Path.read_text, Path.unlink

    def refuse_a(path: Path, *arguments: object, **options: object) -> str:
        if path.parent.name == "a":
            raise PermissionError(13, "Permission denied", str(path))
        return read(path, *arguments, **options)  # type: ignore[arg-type]

    def refuse_b(path: Path, *arguments: object, **options: object) -> None:
        if path.parent.name in ("a", "b"):
            raise PermissionError(13, "Permission denied", str(path))
        unlink(path, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Path, "read_text", refuse_a)
    monkeypatch.setattr(Path, "unlink", refuse_b)
    arrays, hit = cache.get_or_make("basis", "a", lambda: {"x": np.zeros(3)})
    assert not hit and not arrays["x"].any()
    done = CliRunner().invoke(app, ["cache", "--clear", "--json"])
    said = json.loads(done.stdout)
    assert (said["not_removed"], said["unreadable"]) == (1, 1)
    assert said["freed"] > 0 and said["bytes"].keys() == {"basis"}
    text = CliRunner().invoke(app, ["cache", "--clear"]).stdout
    assert "1 entry could not be removed" in text and "1 entry could not be read" in text
    assert [e.key for e in cache.entries()] == ["b"]


@pytest.mark.parametrize("step", ["1e-300", "1e-308", "5e-324"])
@pytest.mark.parametrize("command", ["run", "compare", "reduce"])
def test_more_steps_than_numbers_can_count_are_one_line(command: str, step: str) -> None:
    words = (command, "tiny.yaml", "--out", "a", "--set", f"time.step={step}",
             *(("--reducers", "full,galerkin") if command == "compare" else ()),
             *(("--set", "reducer=galerkin") if command == "reduce" else ()))
    code, error = sparsemor(*words)
    assert code == 2 and "steps of" in error and len(error) < 400 and error.count("\n") == 1, error
    assert [p.name for p in Path().iterdir()] == ["tiny.yaml"]


@pytest.mark.full
def test_files_in_and_beside_a_study_stay() -> None:
    Path("study.yaml").write_text(json.dumps({
        "scene": "tiny.yaml", "keep": True, "set": {"time.end": 0.003},
        "grid": {"time.step": [1e-3]}}), encoding="utf-8")
    words = ("study", "study.yaml", "--out", "a", "--quiet")
    assert sparsemor(*words)[0] == 0
    write("a/notes.txt", "a/runs/1/notes.txt", "a/runs/mine.csv")
    before = Path("a/study.json").stat().st_ino, Path("a/runs/1/result").stat().st_ino
    code, error = sparsemor(*words, "--force")
    assert code == 0, error
    assert kept("a/notes.txt", "a/runs/1/notes.txt", "a/runs/mine.csv")
    assert before[0] != Path("a/study.json").stat().st_ino or (
        before[1] != Path("a/runs/1/result").stat().st_ino)
    assert not Path("a/.replaced").exists() and (Path("a/runs/1/result/header.json")).exists()
    write("a/table.csv")
    code, error = sparsemor(*words, "--force")
    assert code == 2 and "a/table.csv: not written by sparsemor, or changed since" in error
    assert kept("a/table.csv", "a/notes.txt", "a/runs/1/notes.txt", "a/runs/mine.csv")
