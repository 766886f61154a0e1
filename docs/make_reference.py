"""Writes scene-reference.md from the options' own models: `python docs/make_reference.py`."""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from sparsemor.core.registry.option_types import type_in_words
from sparsemor.core.registry.registry import PluginName, Registry
from sparsemor.core.scene.scene import Scene

PAGE = Path(__file__).with_name("scene-reference.md")
KINDS = {
    "body": "bodies.NAME", "material": "material of a flexible body",
    "mesh": "mesh of a flexible body", "joint": "joints.NAME",
    "contact": "contacts.NAME", "normal_law": "normal of a contact",
    "friction_law": "friction of a contact", "load": "loads.NAME",
    "function": "any option that takes a function of time",
    "integrator": "integrator", "reducer": "reducer", "basis": "basis and bases of a reducer",
    "sampler": "sampler of a reducer", "preconditioner": "preconditioner of a reducer",
    "sparse_solver": "solver of a reducer",
    "linear_solver": "linear_solver and linear_solvers",
}
"""Kinds of plugin that a scene can name, and where."""
UNITS = (
    "W/(m^2 K)", "W/(m2 K)", "W/(m K)", "J/(kg K)", "N s/m3", "N/m3", "kg/m^3", "kg/m3", "kg m^2",
    "W/m^2", "m/s^2", "rad/s", "m/s", "1/K", "1/s", "N m", "Pa", "Hz", "rad", "kg", "K", "N", "m",
    "s",
)
_UNIT = re.compile(r"(?:^|(, )| )(" + "|".join(map(re.escape, UNITS)) + r")(?=[.,;:)]|$| \(|, )")
HEAD = """# Scene reference

Every key of a scene, and every option of the plugins that come with sparsemor. This page is written
by `python docs/make_reference.py` from the models that check scenes, and a test compares the two;
`sparsemor plugins NAME` prints the same for any plugin, third-party ones included.

A *plugin* of a kind is written as its name (`bdf1`), when it needs no options, or as
`{use: name, option: value}`. A mapping without `use` sets options of the default plugin. The values
of a function of time have the unit of the option that the function is given to.
How these keys are changed on the command line: [how to swap parts](how-to-swap-parts.md).
"""


def page() -> str:
    """The whole text of scene-reference.md."""
    registry = Registry()
    parts = [HEAD, "## The scene\n", *_table(Scene)]
    for kind, place in KINDS.items():
        parts.append(f"## {kind}\n\nAt: {place}.\n")
        for name in _own(registry, kind):
            cls = registry.get(kind, name.name)
            parts += [f"### {kind} `{name.name}`\n", _words(cls.__doc__ or "") + "\n", *_table(cls)]
    return "\n".join(parts)


def _own(registry: Registry, kind: str) -> list[PluginName]:
    return [p for p in registry.names(kind) if p.distribution == "sparsemor"]


def _table(cls: type[BaseModel]) -> list[str]:
    schema = cls.model_json_schema()
    rows = list(_rows(schema, schema.get("$defs", {}), ""))
    if not rows:
        return ["No options.\n"]
    return ["| key | type | default | unit | meaning |", "|---|---|---|---|---|", *rows, ""]


def _rows(schema: Mapping[str, Any], models: Mapping[str, Any], path: str) -> Iterator[str]:
    """One row an option; those of inner models follow it under their dotted path."""
    required = schema.get("required", ())
    for key, option in schema.get("properties", {}).items():
        about = _words(option.get("description", ""))
        default = "required" if key in required else _default(option)
        cells = [f"`{path}{key}`", type_in_words(option), default, _unit(about), about]
        yield "| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |"
        for inner, below in _inner(option):
            yield from _rows(models[inner], models, f"{path}{key}.{below}")


def _default(option: Mapping[str, Any]) -> str:
    value = option.get("default")
    if "$ref" in option and value is not None:
        return "as below"
    return "none" if value is None else f"`{json.dumps(value)}`"


def _inner(option: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names of the models that an option holds, and what stands between the keys."""
    if "$ref" in option:
        yield option["$ref"].rpartition("/")[2], ""
    for choice in option.get("anyOf", ()):
        yield from _inner(choice)
    values = option.get("additionalProperties")
    if isinstance(values, Mapping):
        for model, below in _inner(values):
            yield model, f"NAME.{below}"


def _unit(about: str) -> str:
    """The first unit after a comma, else the first one: symbols of quantities may look like one,
    as in "Foundation modulus K, N/m3"."""
    found = list(_UNIT.finditer(about))
    after_comma = [m[2] for m in found if m[1]]
    return (after_comma or [m[2] for m in found] or [""])[0]


def _words(text: str) -> str:
    return " ".join(text.split())


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
