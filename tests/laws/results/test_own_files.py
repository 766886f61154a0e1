"""Files of others survive: whatever lies in, beside or below a result that `--force` replaces."""

import os
import shutil
import tempfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sparsemor import InputError, SolveFailed, Status, open_result
from sparsemor.core.results.files.replaceable_files import own_files
from sparsemor.core.results.files.written_files import LISTING, read_listing
from sparsemor.core.results.output_directory import COMPARISON, KEPT, MOVING, OutputDirectory
from sparsemor.core.results.result_writer import ResultWriter
from sparsemor.plugins.publishing.listed_files import (
    add_part,
    add_to_listing,
    append_listed,
    publishing,
    write_listed,
)
from written_runs import RIGID, TIMES, write_run

TABLE = "errors.csv"
NAMES = (
    "notes.txt", "thesis/ch1.tex", TABLE, "table.csv", "study.json", "result.checkpoint",
    "result/notes.txt", "result/header.json", "result/fixed.npz",
    "result/steps-000000.npz", "result/steps-000001.npz", "result/.header.json.part",
    "result/mine/c/0", ".lock", ".sparsemor.lock", LISTING, f"{KEPT}/a.txt",
    f"{KEPT}/{TABLE}", f"{MOVING}/a.txt", ".result.new/a", ".result.old/header.json",
    "full/notes.txt", "full/result", "full/result/header.json", "galerkin",
    "galerkin/result.checkpoint", "runs/1/data.csv", "vtu/arm.pvd", "sub/result/x")
"""Places where users' files may lie, many of which a result has, too."""


class Killed(BaseException):
    """End of a process: nothing that would run after it is run."""


def run(folder: Path) -> None:
    """A result as a run leaves it, of three steps."""
    write_run(folder, (RIGID,), times=TIMES[:3])
    ResultWriter(folder / "result").checkpoint({})


def comparison(folder: Path) -> None:
    for name in ("full", "galerkin"):
        add_part(folder, name, COMPARISON)
        run(folder / name)
    with publishing(folder, COMPARISON) as fresh:
        (fresh / TABLE).write_text("run\n", encoding="utf-8")


def pictured(folder: Path) -> None:
    run(folder)
    add_to_listing(folder, [{"part": "vtu"}])
    with publishing(folder / "vtu") as fresh:
        (fresh / "arm.pvd").write_text("<a/>", encoding="utf-8")


def study(folder: Path) -> None:
    (folder / "runs").mkdir(exist_ok=True)
    add_to_listing(folder, [{"part": "runs/1"}], COMPARISON)
    run(folder / "runs" / "1")
    written = write_listed(folder, "study.json", b"{}")
    append_listed(folder, "study.json", b"\n", written)


RESULTS: dict[str, Callable[[Path], None]] = {
    "run": run, "comparison": comparison, "pictured": pictured, "study": study}


def free(path: Path, root: Path) -> bool:
    """True if a user can write a new file at a path."""
    above = [p for p in path.parents if root in p.parents]
    return not os.path.lexists(path) and all(
        not os.path.lexists(p) or p.is_dir() and not p.is_symlink() for p in above)


def snapshot(root: Path) -> dict[str, bytes | str | None]:
    """What lies below a folder: content of files, targets of links, None for folders."""
    found: dict[str, bytes | str | None] = {}
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root).as_posix()
        found[name] = (os.readlink(path) if path.is_symlink() else None if path.is_dir()
                       else path.read_bytes())
    return found


def force(out: Path, make: str, end: str, moment: int) -> None:
    """A command with --force into a folder. end: of the command; one that is killed is so at the
    rename with this number, or at its end."""
    fails = {"refused": InputError("late", "x"), "killed": Killed(), "ctrl_c": KeyboardInterrupt(),
             "diverged": SolveFailed(Status.DIVERGED, 0.0),
             "interrupted": SolveFailed(Status.INTERRUPTED, 0.0)}
    needs = {"comparison": ((TABLE,), ("full", "galerkin")),
             "study": (("study.json",), ("runs/1",))}
    writes, parts = needs.get(make, ((), ()))
    directory, then, replace, count = OutputDirectory(out), out.with_name("then"), os.replace, 0

    def die() -> None:
        """Keeps what a process that ends here leaves: nothing that follows is done in it."""
        if not then.exists():
            shutil.copytree(out, then, symlinks=True)
        raise Killed

    def replaced(source: Any, target: Any) -> None:
        nonlocal count
        count += 1
        if end == "killed" and count >= moment:
            die()
        replace(source, target)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "replace", replaced)
        with suppress(InputError, SolveFailed, Killed, KeyboardInterrupt), directory.claimed(
                resume=False, force=True, writes=writes, parts=parts):
            directory.require_writable()
            if end not in ("refused", "ctrl_c"):
                RESULTS[make](out)
            if end == "killed":
                die()
            if end != "done":
                raise fails[end]
    if then.exists():
        shutil.rmtree(out)
        then.rename(out)


Tree = tuple[list[tuple[str, str]], list[tuple[str, str]], list[tuple[str, str, int]]]
"""Results by folder, what others put there, and commands with their ends."""


def check(seed: Tree) -> None:
    made, theirs, commands = seed
    place = Path(tempfile.mkdtemp())
    try:
        out, outside = place / "out", place / "outside"
        outside.mkdir()
        out.mkdir()
        (outside / "a.txt").write_text("mine", encoding="utf-8")
        for where, kind in made:
            folder = out / where
            if not os.path.lexists(folder) or where == "." and not any(out.iterdir()):
                folder.mkdir(exist_ok=True)
                RESULTS[kind](folder)
        mine: list[str] = []
        for number, (name, how) in enumerate(theirs):
            path = out / name
            if how == "edit" and path.is_file() and not path.is_symlink() and not any(
                    p.is_symlink() for p in path.parents):
                path.write_bytes(path.read_bytes() + b"mine %d" % number)
                if path.name in (LISTING, "header.json"):
                    continue  # who edits the list of our files says which are ours
            elif free(path, out):
                path.parent.mkdir(parents=True, exist_ok=True)
                if how == "link":
                    path.symlink_to(outside / "a.txt")
                elif how == "folder link":
                    path.symlink_to(outside)
                elif how == "folder":
                    path.mkdir()
                else:
                    path.write_text(f"mine {number}", encoding="utf-8")
            else:
                continue
            mine.append(path.relative_to(out).as_posix())
        inner = {where for where, _ in made if where != "."}
        before, beside = snapshot(out), snapshot(outside)
        kept = {n: c for n, c in before.items() if n in mine or n.partition("/")[0] in inner}
        for kind, end, moment in commands:
            force(out, kind, end, moment)
            after = snapshot(out)
            lost = [n for n, c in kept.items() if n not in after or after[n] != c]
            assert not lost, (kind, end, lost)
            assert snapshot(outside) == beside
    finally:
        shutil.rmtree(place)


TREES = st.tuples(
    st.lists(st.tuples(st.sampled_from([".", ".", "sub", "deep"]), st.sampled_from([*RESULTS])),
             min_size=1, max_size=3),
    st.lists(st.tuples(st.sampled_from(NAMES), st.sampled_from(
        ["file", "file", "edit", "link", "folder link", "folder"])), max_size=6),
    st.lists(st.tuples(st.sampled_from([*RESULTS]), st.sampled_from(
        ["done", "done", "refused", "killed", "ctrl_c", "diverged", "interrupted"]),
        st.integers(1, 20)), min_size=1, max_size=3))


@settings(max_examples=12, deadline=None, derandomize=True)
@given(TREES)
def test_nothing_of_others_is_lost(seed: Tree) -> None:
    check(seed)


@pytest.mark.full
@settings(max_examples=150, deadline=None)
@given(TREES)
def test_nothing_of_others_is_lost_in_many_trees(seed: Tree) -> None:
    check(seed)


@pytest.mark.parametrize("kind", [*RESULTS])
@pytest.mark.parametrize("end", ["done", "refused", "killed"])
def test_a_result_is_replaced_or_kept_as_a_whole(tmp_path: Path, kind: str, end: str) -> None:
    """The laws above hold for a command that does nothing, too: this one says what it does."""
    out = tmp_path / "out"
    out.mkdir()
    RESULTS[kind](out)
    (out / "notes.txt").write_text("mine", encoding="utf-8")
    before, own = snapshot(out), own_files(out)
    assert not own.changed
    assert {*own.files} == {n for n, c in before.items() if c is not None} - {"notes.txt"}
    force(out, "run", end, 2)
    if end != "done":
        force(out, "run", "refused", 1)
        assert snapshot(out) == before
        force(out, "run", "done", 1)
    assert {p.name for p in out.iterdir()} == {"notes.txt", "result", "result.checkpoint"}
    assert len(open_result(out).times) == 3
    assert {*own_files(out).files} == {
        n for n, c in snapshot(out).items() if c is not None} - {"notes.txt"}


def test_lists_that_name_files_elsewhere_are_not_followed(tmp_path: Path) -> None:
    """A list comes with a result from somebody else: it may say anything."""
    out, thesis = tmp_path / "out", tmp_path / "thesis.tex"
    thesis.write_text("mine", encoding="utf-8")
    out.mkdir()
    (out / "link").symlink_to(tmp_path)
    line = {"size": 4, "crc32": zlib.crc32(b"mine")}
    add_to_listing(out, [
        *({"file": name, **line} for name in ("../thesis.tex", str(thesis), "link/thesis.tex")),
        *({"part": name} for name in ("..", ".", "", str(tmp_path), "link", 3, None)),
        {"file": "a\0b", **line}, {"file": "x"}, {"file": ["y"]}, {"part": "full/../.."}])
    with (out / LISTING).open("ab") as file:
        file.write(b'{"file": "half')
    assert {*own_files(out).files} == {LISTING}
    add_to_listing(out, [{"part": "full"}])
    listing = read_listing(out)
    assert listing is not None and "full" in listing.parts  # a half line spoils no other
