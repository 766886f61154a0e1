"""Shared parts of the commands: options, scenes and keys that they name, output directories."""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import (
    AbstractContextManager,
    ExitStack,
    contextmanager,
    suppress,
)
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from sparsemor.core.errors import Damaged, Fault, InputError
from sparsemor.core.registry.validation_errors import shown
from sparsemor.core.results.files.written_files import require_ours
from sparsemor.core.results.model_file import is_model_file
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.scene.overrides import parse_settings
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.scene.yaml_reader import LocatedError
from sparsemor.core.simulation.progress import progress_bar
from sparsemor.plugins.command_line.completion import scene_names, settings, stored_runs
from sparsemor.plugins.publishing.listed_files import add_to_listing

T = TypeVar("T")

SceneName = Annotated[
    str, typer.Argument(metavar="SCENE", help="A packaged scene's name (`sparsemor plugins scene` "
                        "lists them), or a scene file.", autocompletion=scene_names)]
Settings = Annotated[
    list[str] | None, typer.Option(
        "--set", metavar="KEY=VALUE",
        help="Change the scene: time.end=0.5, reducer=full, reducer.sampler.use=random. May be "
             "repeated.", autocompletion=settings)]
StoredRun = Annotated[str, typer.Argument(
    metavar="RUN", help="Directory of a run, finished or not.", autocompletion=stored_runs)]
At = Annotated[str | None, typer.Option(
    "--at", help="Times in s, such as 0.3,1.2; the nearest stored steps are used.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
Resume = Annotated[bool, typer.Option(
    "--resume", help="Continue an interrupted run, or one that has ended to a later time.end.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier result.")]
ReplaceFile = Annotated[bool, typer.Option("--force", help="Replace an existing file.")]

OPTIONS = frozenset({"out", "resume", "reducers", "samplers", "required", "rows", "atoms",
                     "integrators", "at", "items", "workers", "analysis", "spin", "about", "count",
                     "input", "frequencies", "outputs", "scaled"})
"""Names of command-line options that input errors may refer to; no key of a scene has such a
name."""


def out_option(otherwise: str) -> Any:
    """Option `--out`, the output directory; otherwise: default directory, for the help text."""
    return typer.Option("--out", parser=path_of, metavar="DIRECTORY",
                        help=f"Directory for the result (default: {otherwise}).")


def path_of(text: str) -> Path:
    """Path that an option names. An empty one, as of a variable of the shell that is not set, is
    refused: it would be the working directory."""
    if not str(text).strip():
        raise typer.BadParameter("the path is empty")
    return Path(text)


def check_new_file(file: Path, replace: bool) -> None:
    """Raises InputError where a command cannot write to `file`, or would replace it unasked.
    `replace` is for files that this program wrote and nobody changed since."""
    if file.is_dir():
        raise InputError(f"{file} is a folder: give the name of a file", "out")
    if os.path.lexists(file) and not replace:
        raise InputError(f"{file} exists: choose another file, or replace it with --force", "out")
    if not file.parent.is_dir():
        raise InputError(f"there is no folder {file.parent}", "out")
    require_ours(file.parent, [file.name])
    if not os.access(file.parent, os.W_OK):
        raise InputError(f"{file.parent} is not writable: choose another --out", "out")


def load_with(scene: str, settings: Sequence[str] | None) -> Scene:
    """Loads a scene file or a packaged scene, with the changes of `--set`. Raises
    `LocatedError`."""
    if is_model_file(Path(scene)):
        text = f"{scene}: is a reduced model, which `sparsemor run` takes; give its scene here"
        raise LocatedError([Fault("", text)], [text])
    with located_in_settings():
        overrides = parse_settings(settings or ())
    return load(scene, overrides)


@contextmanager
def located_in_settings() -> Iterator[None]:
    """Context that locates input errors in the options `--set`. Raises `LocatedError`."""
    try:
        yield
    except LocatedError:
        raise
    except InputError as error:
        lines = [f"--set {f.key}: {f.message}" if f.key else f.message for f in error.faults]
        raise LocatedError(error.faults, lines) from None


@contextmanager
def located_in(scene: Scene | None = None) -> Iterator[None]:
    """Context that locates input errors: options of the command are named as `--out`, other keys by
    file, line and column of the scene. Without a scene every key is an option. Raises
    `LocatedError`."""
    try:
        yield
    except (LocatedError, Damaged):  # what is damaged on disk is nowhere in the scene
        raise
    except InputError as error:
        own = [f for f in error.faults if scene is None or f.key in OPTIONS]
        rest = [f for f in error.faults if f not in own]
        lines = [f"--{f.key}: {f.message}" if f.key else f.message for f in own]
        if rest and scene is not None:
            lines += scene.locate(InputError(rest))
        raise LocatedError(error.faults, lines) from error


def words(text: str | None) -> list[str] | None:
    """The items of a comma-separated list; None stays None."""
    return None if text is None else [w.strip() for w in text.split(",") if w.strip()]


def items(
    option: str, text: str | None, read: Callable[[str], T], form: str
) -> list[T] | None:
    """Values of a comma-separated list, each converted by `read`; None stays None. Raises
    InputError that names the option and describes the expected form of an item."""
    found: list[T] = []
    for word in words(text) or ():
        try:
            found.append(read(word))
        except ValueError:
            raise InputError(f"{form} (got {shown(word)})", option) from None
    if text is not None and not found:
        raise InputError(f"{form} (got nothing)", option)
    return None if text is None else found


def times_at(text: str | None) -> list[float] | None:
    """Times of the option `--at`, s; None if it is left out."""
    return items("at", text, finite_number, "must be times in s, separated by commas")


def finite_number(word: str) -> float:
    value = float(word)
    if not isfinite(value):
        raise ValueError(word)
    return value


def warn(notes: Sequence[str]) -> None:
    """Prints warnings about a run on standard error."""
    for note in notes:
        typer.echo(f"warning: {note}", err=True)


def inform(notes: Sequence[str]) -> None:
    """Prints notes about a run on standard error."""
    for note in notes:
        typer.echo(f"note: {note}", err=True)


def progress(quiet: bool) -> AbstractContextManager[Sequence[object]]:
    """Context with the observers of a run: a progress bar if standard error is a terminal."""
    return progress_bar(not quiet and sys.stderr.isatty())


@contextmanager
def place_for_result(
    out: Path, resume: bool | None, force: bool, writes: Sequence[str] = (),
    parts: Sequence[str] = (),
) -> Iterator[None]:
    """Context that claims the output directory until the end of this command
    (`OutputDirectory.claimed`). resume: None for a command that does not continue."""
    with ExitStack() as stack:
        with located_in():
            stack.enter_context(OutputDirectory(out).claimed(
                resume=resume, force=force, writes=writes, parts=parts))
        yield


@contextmanager
def part_of(run: Path, folder: Path) -> Iterator[None]:
    """Context in which files are written to a folder, which is listed as a part of the run's
    directory if it is new and inside it: `--force` replaces both."""
    run, place = run.absolute(), folder.absolute()
    new = run in place.parents and not OutputDirectory(place).occupied()
    yield
    if new:
        with suppress(OSError, InputError):  # the run may be of another user
            add_to_listing(run, [{"part": place.relative_to(run).as_posix()}])
