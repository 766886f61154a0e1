"""Reproduction of a paper in one folder: runs, studies, verdicts, pages and tables."""

import json
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sparsemor.core.errors import InputError
from sparsemor.core.linalg.threads import fixed_threads
from sparsemor.core.registry.registry import Registry, suggestions
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.plugins.liang2026 import PAPER
from sparsemor.plugins.liang2026.item_functions import Results
from sparsemor.plugins.liang2026.page import write_pages
from sparsemor.plugins.liang2026.paper import BROKEN, PaperFile, PaperItem
from sparsemor.plugins.liang2026.runs import PaperRuns, commands_of
from sparsemor.plugins.liang2026.verdicts import Verdict, judged
from sparsemor.plugins.publishing.listed_files import add_to_listing, write_listed
from sparsemor.plugins.publishing.tables import csv_table

ABOUT, PICTURES = "reproduction.json", "pictures"
TABLES = ("verdicts.csv", "numbers.csv")


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction:
    """Completed reproduction: verdicts in the order of the paper file. files: pages and tables."""

    file: PaperFile
    folder: Path
    verdicts: tuple[Verdict, ...]
    files: tuple[Path, ...]

    @property
    def counts(self) -> Mapping[str, int]:
        """Grade -> number of items."""
        return Counter(v.grade for v in self.verdicts)

    @property
    def incomplete(self) -> bool:
        """True if an item could not be computed."""
        return any(v.grade == BROKEN for v in self.verdicts)


def reproduce(
    scene: str = "", *, quick: bool = False, out: str | Path | None = None,
    items: Sequence[str] = (), workers: int | None = None, paper: str | Path = PAPER,
    force: bool = False, on_progress: Callable[[str], None] = lambda line: None,
) -> Reproduction:
    """Recomputes the figures and tables of a paper and writes pages with the verdicts.

    scene: scene whose items are computed ("": all); quick: shorter runs and fewer seeds; out:
    folder, by default `runs/reproduce` or `runs/reproduce-quick`, where a repeated call keeps what
    is complete; items: `fig_4`, `table_2`, ..; workers: number of processes (default: number of
    processors); paper: packaged paper or paper file; force: replace an earlier reproduction;
    on_progress: called with a line of text. Raises InputError before anything is written.
    """
    file = PaperFile.read(paper, Registry())
    chosen = chosen_items(file, scene, items)
    if workers is not None and workers < 1:
        raise InputError(f"at least 1 (got {workers})", "workers")
    name = "reproduce-quick" if quick else "reproduce"
    folder = (Path(out) if out is not None else Path("runs", name)).absolute()
    with OutputDirectory(folder).claimed(
            resume=not force, force=force, replaceable=lambda: (folder / ABOUT).is_file(),
            kind="reproductions only, and this is none",
            writes=(ABOUT, *TABLES, "index.html", *(f"{s}.html" for s in file.scenes))):
        _begin(folder, file, quick, force)
        work = PaperRuns(file, chosen, folder, quick, on_progress)
        work.execute(workers or os.cpu_count() or 1)
        results, verdicts = Results(folder, work.failed), []
        for item in chosen:
            with fixed_threads():
                verdicts.append(judged(item, results, folder / PICTURES))
            on_progress(f"{item.id}: {verdicts[-1].grade}")
        commands = {i.id: commands_of(file, i, quick) for i in chosen}
        files = [*write_pages(file, verdicts, commands, folder, quick),
                 *_tables(chosen, verdicts, commands, folder)]
    return Reproduction(file, folder, tuple(verdicts), tuple(files))


def chosen_items(file: PaperFile, scene: str = "", items: Sequence[str] = ()) -> list[PaperItem]:
    """Items of a scene, or of the given names. Raises InputError for unknown names."""
    if scene and scene not in file.scenes:
        raise InputError(f"SCENE: {suggestions(scene, list(file.scenes), 'there are')}")
    known = [i.id for i in file.items]
    for name in items:
        if name not in known:
            raise InputError(f"no figure or table {name!r}: {suggestions(name, known)}", "items")
    found = [i for i in file.items if scene in ("", i.scene) and (not items or i.id in items)]
    if not found:
        raise InputError(f"none of {', '.join(items)} is of {scene}", "items")
    return found


def _begin(folder: Path, file: PaperFile, quick: bool, force: bool) -> None:
    """Marks a new folder. Raises InputError if it holds another kind of reproduction, or other
    data; not with `force`: an earlier reproduction has then been set aside, and what is left are a
    user's own files, which stay."""
    about = folder / ABOUT
    if not about.is_file():
        if not force and OutputDirectory(folder).occupied():
            raise InputError(f"{folder} is not empty and contains no reproduction: choose another "
                             "--out", "out")
        OutputDirectory(folder).make()
        add_to_listing(folder, [{"part": PICTURES}, {"part": "studies"}])
        write_listed(
            folder, ABOUT, (json.dumps({"title": file.title, "quick": quick}) + "\n").encode())
    elif json.loads(about.read_text(encoding="utf-8")).get("quick") is not quick:
        raise InputError(f"{folder} contains a reproduction with{'out' * quick} --quick: choose "
                         "another --out", "out")


def _tables(
    items: Sequence[PaperItem], verdicts: Sequence[Verdict], commands: Mapping[str, Sequence[str]],
    folder: Path,
) -> list[Path]:
    """Writes verdicts.csv and numbers.csv; returns their paths."""
    rows: list[list[object]] = [
        [i.id, i.scene, i.title, v.grade, v.rule, commands[i.id][0], "; ".join(v.faults)]
        for i, v in zip(items, verdicts, strict=True)]
    numbers: list[list[object]] = [[v.item, n.name, n.label, n.unit, n.paper, n.here]
                                   for v in verdicts for n in v.numbers]
    rows.insert(0, ["item", "scene", "title", "verdict", "rule", "command", "faults"])
    numbers.insert(0, ["item", "name", "label", "unit", "published", "here"])
    for name, table in zip(TABLES, (rows, numbers), strict=True):
        write_listed(folder, name, csv_table(table).encode())
    return [folder / name for name in TABLES]
