"""Writes docs/reference/contracts.md from core/protocols: `python docs/make_contracts.py`."""

from collections.abc import Iterable, Mapping
from inspect import getdoc
from pathlib import Path

from sparsemor.core import Part, ReducedTerm, StepMemory, StepSolver, Term
from sparsemor.core.model.optional_features import FEATURES
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.registry.contracts import CONTRACTS, PARTS, members, required, shape
from sparsemor.plugins.commands.validate_schema_plugins import first_sentence

PASSED = {"term": Term, "reduced term": ReducedTerm, "step solver": StepSolver,
          "memory of a step solver": StepMemory}
FOLDER = Path(__file__).with_name("reference")
HEAD = """# Contracts of plugins

Each kind of plugin has a contract, a class of `sparsemor.core` from which its plugins derive: what
has no default must be written, everything else may be. Docstrings state shapes and units. This page
is written by `python docs/make_contracts.py` from `core/protocols`, and a test compares the two.
`sparsemor plugins NAME` prints the defaults that one plugin replaces. Plugins for version 2 of the
extension API: [version 3](../developers/version-3.md).
How a plugin is written: [how to write a plugin](../how-to-write-a-plugin.md).
"""


def pages() -> dict[str, str]:
    """Name of the generated page of docs/reference -> its text."""
    parts = [HEAD, "## Required\n", *_table((kind, (p,)) for kind, p in CONTRACTS.items()),
             "## Defaults\n", *_defaults(CONTRACTS, Plugin),
             "## Required of what `build` returns\n",
             *_table((kind, (p,)) for kind, p in PARTS.items()),
             "## Defaults of what `build` returns\n", *_defaults(PARTS, Part),
             "## Defaults of what is passed between parts\n", *_defaults(PASSED, object),
             "## Features that need a method\n",
             "`validate` refuses a scene where a plugin keeps the default of such a method.\n",
             *_features()]
    return {"contracts.md": "\n".join(parts)}


def _table(rows: Iterable[tuple[str, tuple[type, ...]]]) -> list[str]:
    made = [f"|{kind}|`{p.__name__}`|{', '.join(f'`{m}`' for m in required(p).values())}|"
            f"{first_sentence(p.__doc__ or '')}|" for kind, protocols in rows for p in protocols]
    return ["|kind|contract|members|meaning|", "|---|---|---|---|", *made, ""]


def _defaults(contracts: Mapping[str, type], base: type) -> list[str]:
    """Members with a default, those of every one of the contracts first."""
    every = members(base)
    rows = [("any", n, m) for n, m in every.items() if n not in required(base)]
    rows += [(kind, n, m) for kind, c in contracts.items() if issubclass(c, base)
             for n, m in members(c).items() if n not in required(c) and n not in every]
    return ["|kind|member|meaning|", "|---|---|---|",
            *(f"|{kind}|`{shape(n, m)}`|{first_sentence(getdoc(m) or '')}|"
              for kind, n, m in rows if callable(m) or isinstance(m, property)), ""]


def _features() -> list[str]:
    made = [f"|{f.name}|`{f.option}`|{f.kind}|`{f.method}`|{f.need}|" for f in FEATURES]
    return ["|feature|option|needed of|method|it has to|", "|---|---|---|---|---|",
            *made, ""]


if __name__ == "__main__":
    for name, text in pages().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
