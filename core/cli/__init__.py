"""Command line `sparsemor`: text output for people, JSON output (`--json`) for programs.

Exit code 0: done. 1: a run failed. 2: the input is wrong, and nothing was written. 130: Ctrl-C, or
a signal that ends the program (SIGTERM, SIGHUP).
"""

import os
import signal
import sys
from contextlib import suppress
from typing import Annotated


def _open_streams() -> None:
    """Opens the null device in place of standard streams that are closed: the next file would get
    their number, and what is printed would get into it."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))


_open_streams()
try:
    import typer

    from sparsemor.core.cli.commands import Commands
    from sparsemor.core.cli.exit_codes import FAILED, INTERRUPTED
except KeyboardInterrupt:  # Ctrl-C in the first half second, while all this is read
    sys.stderr.write("interrupted\n")
    raise SystemExit(130) from None

app = typer.Typer(
    cls=Commands, no_args_is_help=True, pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]})


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(version("sparsemor"))
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True,
                           help="Print the version.")
    ] = False,
) -> None:
    """Sparse model order reduction of thermomechanical flexible multibody systems."""


def main() -> None:
    """Entry point of the `sparsemor` program."""
    for name in ("SIGTERM", "SIGHUP"):  # as Ctrl-C: temporary folders are removed
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, lambda *_: signal.raise_signal(signal.SIGINT))
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:
        with suppress(OSError):
            sys.stderr.write("interrupted\n")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # the reader of a pipe, such as `head`, has left
        _discard_output()
        sys.exit(FAILED)
    except OSError as error:  # a full device behind a standard stream
        with suppress(OSError):
            sys.stderr.write(f"{error.filename or 'standard output'}: {error.strerror or error}\n")
            sys.stderr.flush()
        _discard_output()
        sys.exit(FAILED)


def _discard_output() -> None:
    """Sends what is left in the buffers of the standard streams, which Python writes at its end, to
    the null device."""
    for number in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), number)
