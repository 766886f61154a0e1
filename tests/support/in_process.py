"""The program in the process of a test: most of what a short command takes is to start."""

from typing import NamedTuple

from typer.testing import CliRunner

from sparsemor.core.cli import app


class Done(NamedTuple):
    """What a command left: exit code, standard output and standard error."""

    code: int
    out: str
    err: str

    @property
    def lines(self) -> list[str]:
        """Of standard error."""
        return self.err.splitlines()


def sparsemor(*words: object, code: int | None = None) -> Done:
    """The command; code: the exit code that it must have."""
    done = CliRunner().invoke(app, [*map(str, words)], prog_name="sparsemor")
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert code is None or done.exit_code == code, done.output
    return Done(done.exit_code, done.stdout, done.stderr)
