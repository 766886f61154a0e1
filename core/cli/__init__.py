"""Command line `sparsemor`: text output for people, JSON output (`--json`) for programs.

Exit code 0: done. 1: a run failed. 2: the input is wrong, and nothing was written. 130: Ctrl-C.
"""

import os
import sys
from typing import Annotated

try:
    import typer

    from sparsemor.core.cli.advise import advise
    from sparsemor.core.cli.cache import cache
    from sparsemor.core.cli.compare import compare
    from sparsemor.core.cli.export import animate, export, pictures
    from sparsemor.core.cli.new_plugin import new_plugin
    from sparsemor.core.cli.options import FAILED, INTERRUPTED
    from sparsemor.core.cli.plugins import plugins, schema, validate
    from sparsemor.core.cli.reduce import reduce
    from sparsemor.core.cli.reproduce import reproduce
    from sparsemor.core.cli.run import run
    from sparsemor.core.cli.stability import stability
    from sparsemor.core.cli.study import study
except KeyboardInterrupt:  # Ctrl-C in the first half second, while all this is read
    sys.stderr.write("interrupted\n")
    raise SystemExit(130) from None

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]})
for command in (run, reduce, advise, compare, study, reproduce, stability, export, pictures,
                animate, validate, schema, plugins, cache):
    app.command()(command)
app.command("new-plugin")(new_plugin)


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
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # the reader of a pipe, such as `head`, has left
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(FAILED)
