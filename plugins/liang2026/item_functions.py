"""Parts of an item, which are functions: a quantity returns a number or text, a picture its
figures.

The parameters of such a function are the options of the part in a paper file. An option of the type
`RunResult` is written as the name of a run, one of the type `Rows` as the name of a study; the
function gets them opened.
"""

import json
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias, get_type_hints

from pydantic import create_model

from sparsemor.core.errors import InputError
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.results.run_result import RunResult, open_result
from sparsemor.plugins.comparison.error_norms import measure_errors

Value: TypeAlias = float | str | bool | None
Known: TypeAlias = Mapping[str, Value]
"""Values of an item that were computed before, which a quantity may take."""
Rows: TypeAlias = Sequence[Mapping[str, Any]]
"""Table of a study."""
_WRITTEN: Mapping[Any, Any] = {
    RunResult: str, RunResult | None: str, Rows: str, Mapping[str, RunResult]: dict[str, str]}
"""Type of a parameter that is opened -> type of its option."""
errors_of = lru_cache(maxsize=64)(measure_errors)
"""Errors of a run relative to a reference run, measured once."""


def reason_of(error: Exception) -> str:
    """An error as one line; of one that is no InputError the traceback is printed."""
    if isinstance(error, InputError):
        return "; ".join(str(error).splitlines())
    traceback.print_exception(error, file=sys.stderr)
    return f"{type(error).__name__}: {error}"


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """Completed runs and studies in the folder of a reproduction; failed: name -> reason why one
    could not be made."""

    folder: Path
    failed: Mapping[str, str] = field(default_factory=dict)
    _runs: dict[str, RunResult] = field(default_factory=dict)

    def run(self, name: str) -> RunResult:
        """Result of a run. Raises InputError if there is none."""
        if name not in self._runs:
            self._runs[name] = open_result(self._folder("runs", name))
        return self._runs[name]

    def rows(self, study: str) -> Rows:
        """Rows of a study's table. Raises InputError if there are none."""
        table = self._folder("studies", study) / "table.jsonl"
        if not table.is_file():
            raise InputError(f"there is no table {table}")
        return [json.loads(line) for line in table.read_text(encoding="utf-8").splitlines()]

    def opened(self, kind: Any, name: Any) -> Any:
        """Results that an option of a quantity or picture names; kind: type of its parameter.

        `Rows`: the table of the study `name`; one run: its result, None for ""; otherwise `name` is
        a mapping label -> run, of which the results are returned by label.
        """
        if kind == Rows:
            return self.rows(name)
        if isinstance(name, str):
            return self.run(name) if name else None
        return {label: self.run(run) for label, run in name.items()}

    def _folder(self, kind: str, name: str) -> Path:
        if name in self.failed:
            raise InputError(f"{name}: {self.failed[name]}")
        return self.folder / kind / name


class PaperPart(Plugin):
    """Base class of the quantities and pictures of an item: the options of one function, as fields
    (`part_of` makes a subclass of each function)."""

    function: ClassVar[Callable[..., Any]]
    kinds: ClassVar[Mapping[str, Any]]
    """Option -> type of the parameter, of those that are opened."""

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs that it reads."""
        named = [getattr(self, o) for o, kind in self.kinds.items() if kind != Rows]
        return tuple(n for v in named for n in ((v,) if isinstance(v, str) else v.values()) if n)

    @property
    def studies(self) -> tuple[str, ...]:
        """Names of the studies that it reads."""
        return tuple(getattr(self, o) for o, kind in self.kinds.items() if kind == Rows)

    def made(self, results: Results, known: Known) -> Any:
        """Value or figures. Raises InputError if a run lacks the data."""
        given = {**dict(self), "known": known}
        given |= {n: results.opened(kind, given[n]) for n, kind in self.kinds.items()}
        return type(self).function(
            **{n: given[n] for n in signature(type(self).function).parameters})


def part_of(function: Callable[..., Any], key: str) -> type[PaperPart]:
    """Class of the options of a function; key: option that holds its name. A parameter that is
    opened (a run, the table of a study) is written by name in the option."""
    hints = get_type_hints(function, include_extras=True)
    options: dict[str, Any] = {key: (Literal[function.__name__], ...)}
    for name, parameter in signature(function).parameters.items():
        kind, default = hints[name], parameter.default
        if name != "known":  # values computed before, which the item passes on: no option
            empty = "" if default is None and kind in _WRITTEN else default
            options[name] = (_WRITTEN.get(kind, kind), ... if default is Parameter.empty else empty)
    made = create_model(function.__name__, __base__=PaperPart, __doc__=function.__doc__, **options)
    made.function = staticmethod(function)
    made.kinds = {n: hints[n] for n in options if hints.get(n) in _WRITTEN}
    return made
