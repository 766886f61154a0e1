"""Exit codes of commands, and what they print at their end."""

import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from typing import Any, TextIO

import typer

from sparsemor.core.errors import InputError
from sparsemor.core.registry.boundary import naming_plugins
from sparsemor.core.scene.yaml_reader import LocatedError
from sparsemor.core.status import SolveFailed, Status

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130

_json_stream: list[TextIO] = []
"""Standard output, while what others print goes to standard error."""


@contextmanager
def only_json(wanted: bool = True) -> Iterator[None]:
    """Context in which standard output has what `print_json` writes, and nothing else: what plugins
    and the programs that they start print goes to standard error."""
    if not wanted or _json_stream:
        yield
        return
    with ExitStack() as stack:
        out = sys.stdout
        with suppress(OSError, ValueError, AttributeError):  # one that is closed or no file
            out.flush()
            if out.fileno() == 1:
                saved_descriptor = os.dup(1)
                out = stack.enter_context(os.fdopen(
                    saved_descriptor, "w", encoding=out.encoding, errors=out.errors, closefd=True))
                os.dup2(2, 1)
                stack.callback(_restore, saved_descriptor)
        stack.enter_context(redirect_stdout(sys.stderr))
        _json_stream.append(out)
        stack.callback(_json_stream.clear)
        yield


def _restore(kept: int) -> None:
    """Makes standard output what it was; what a plugin has left in the buffer goes where the rest
    of it went."""
    with suppress(OSError, ValueError):
        sys.__stdout__.flush()  # type: ignore[union-attr]
    os.dup2(kept, 1)


@contextmanager
def exit_codes(as_json: bool = False) -> Iterator[None]:
    """Context that prints input errors and failed runs as clear lines and exits with the matching
    code."""
    with only_json(as_json):
        try:
            with naming_plugins():
                yield
        except InputError as error:
            lines = error.lines if isinstance(error, LocatedError) else str(error).splitlines()
            if as_json:
                print_json({"status": "bad_input", "errors": list(lines)})
            leave(lines, BAD_INPUT)
        except SolveFailed as error:
            result = getattr(error, "result", None)
            if as_json:
                summary = result.summary if result is not None else {}
                print_json({**summary, "status": error.status.value, "message": str(error)})
            where = [f"results up to the failure: {result.path}"] if result is not None else []
            stopped = error.status is Status.INTERRUPTED
            leave([str(error), *where], INTERRUPTED if stopped else FAILED)
        except KeyboardInterrupt:  # before the first step, or a second time
            if as_json:
                print_json({"status": Status.INTERRUPTED.value, "message": "interrupted"})
            leave(["interrupted"], INTERRUPTED)
        except BrokenPipeError:  # the program's end is quiet about it
            raise
        except OSError as error:  # such as a full disk; what was committed is readable
            lines = [f"{error.filename or 'input or output'}: {error.strerror or error}"]
            if as_json:
                print_json({"status": "failed", "message": lines[0]})
            leave(lines, FAILED)


def leave(lines: Sequence[str], code: int) -> None:
    for line in lines:
        typer.echo(line, err=True)
    raise typer.Exit(code)


def print_json(value: Mapping[str, Any]) -> None:
    typer.echo(json.dumps(value, indent=2, allow_nan=False, default=str),
               file=_json_stream[-1] if _json_stream else None)
