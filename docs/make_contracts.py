"""Writes contracts.md from core/protocols: `python docs/make_contracts.py`."""

from collections.abc import Iterable
from pathlib import Path

from sparsemor.core.cli.plugins import first_sentence
from sparsemor.core.model.features import FEATURES
from sparsemor.core.protocols.capabilities import BUILT, CAPABILITIES, EVERY, OTHERS
from sparsemor.core.registry.contracts import CONTRACTS, PARTS, shapes

PAGE = Path(__file__).with_name("contracts.md")
HEAD = """# Contracts of plugins

Members that a plugin must have, and optional abilities that it may have. All names are imported
from `sparsemor.core`; their docstrings state shapes and units. This page is written by
`python docs/make_contracts.py` from `core/protocols`, and a test compares the two.
`sparsemor plugins NAME` prints the abilities of one plugin.
How a plugin is written: [how to write a plugin](how-to-write-a-plugin.md).
"""


def page() -> str:
    """The whole text of contracts.md."""
    parts = [HEAD, "## Required\n", *_table((kind, (p,)) for kind, p in CONTRACTS.items()),
             "## Required of what `build` returns\n",
             *_table((kind, (p,)) for kind, p in PARTS.items()),
             "## Optional abilities of plugins\n", *_table({**CAPABILITIES, "any": EVERY}.items()),
             "## Optional abilities of what `build` returns\n", *_table(BUILT.items()),
             "## Optional abilities of what is passed between parts\n", *_table(OTHERS.items()),
             "## Features that need an ability\n",
             "`validate` refuses a scene where a plugin lacks what a feature of the scene needs.\n",
             *_features()]
    return "\n".join(parts)


def _table(rows: Iterable[tuple[str, tuple[type, ...]]]) -> list[str]:
    made = [f"| {kind} | `{p.__name__}` | {', '.join(f'`{m}`' for m in shapes(p))} | "
            f"{first_sentence(p.__doc__ or '')} |" for kind, protocols in rows for p in protocols]
    return ["| kind | protocol | members | meaning |", "|---|---|---|---|", *made, ""]


def _features() -> list[str]:
    made = [f"| {f.name} | `{f.option}` | {f.kind}"
            + f" | `{f.ability.__name__}` | {f.need} |" for f in FEATURES]
    return ["| feature | option | needed of | protocol | it has to |", "|---|---|---|---|---|",
            *made, ""]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
