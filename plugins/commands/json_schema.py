"""JSON schema of a scene, with the options of all installed plugins."""

import copy
from typing import Any

from pydantic import BaseModel

from sparsemor.core.errors import InputError
from sparsemor.core.registry.plugin_option import Slot
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.scene import Scene

_HERE = "#/$defs/"


def scene_schema(registry: Registry | None = None) -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a scene, for editors and other programs.

    Where a plugin is chosen (a slot), its name is accepted if it needs no options, or an object
    with `use` and the plugin's options; third-party plugins are included. Plugins that cannot be
    imported are left out.
    """
    found = _Definitions(registry or Registry())
    schema = found.of_model(Scene, "Scene")
    found.open_slots()
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "$defs": dict(sorted(found.definitions.items())),
    }


class _Definitions:
    """Collector of schema definitions; each slot that is found in one adds the plugins of its
    kind."""

    def __init__(self, registry: Registry) -> None:
        self.registry = registry
        self.definitions: dict[str, Any] = {}
        self._wanted: list[str] = []

    def of_model(self, cls: type[BaseModel], prefix: str) -> dict[str, Any]:
        """JSON schema of a pydantic model; its inner definitions are stored under `prefix`."""
        schema = cls.model_json_schema()
        inner = schema.pop("$defs", {})
        for name, definition in inner.items():
            self.definitions[f"{prefix}.{name}"] = self._linked(definition, prefix)
        linked: dict[str, Any] = self._linked(schema, prefix)
        return linked

    def open_slots(self) -> None:
        done: set[str] = set()
        while self._wanted:
            kind = self._wanted.pop()
            if kind not in done:
                done.add(kind)
                self.definitions[_slot(kind)] = self._any_of(kind)

    def _any_of(self, kind: str) -> dict[str, Any]:
        """Schema of a plugin of this kind: the name of one without required options, or `use` with
        options."""
        choices: list[Any] = []
        for name in sorted(map(self.registry.spelling, self.registry.names(kind))):
            try:
                cls = self.registry.get(kind, name)
            except InputError:
                continue
            options = self.of_model(cls, f"{kind}.{name}")
            if not options.get("required"):
                choices.append({"const": name})
            choices.append(_with_use(options, name))
        return {"anyOf": choices} if choices else {"not": {}}

    def _options_alone(self, kind: str, default: object) -> list[dict[str, Any]]:
        """Schemas of a mapping without `use`: the options of the slot's default plugin."""
        if not isinstance(default, str):
            return []
        try:
            return [self.of_model(self.registry.get(kind, default), f"{kind}.{default}")]
        except InputError:
            return []

    def _linked(self, schema: Any, prefix: str) -> Any:
        """The schema with each slot replaced by a reference to the plugins of its kind, which is
        noted in `_wanted` for later, and its own references moved under `prefix`."""
        if isinstance(schema, list):
            return [self._linked(item, prefix) for item in schema]
        if not isinstance(schema, dict):
            return schema
        if isinstance(schema.get(Slot.MARK), str):
            kind = schema[Slot.MARK]
            self._wanted.append(kind)
            others = {k: v for k, v in schema.items() if k != Slot.MARK}
            opened = {"$ref": _HERE + _slot(kind)}
            # of a default plugin, its options without `use`, too
            default = self._options_alone(kind, schema.get("default"))
            return {**others, **({"anyOf": [opened, *default]} if default else opened)}
        linked = {k: self._linked(v, prefix) for k, v in schema.items()}
        if isinstance(linked.get("$ref"), str) and linked["$ref"].startswith(_HERE):
            linked["$ref"] = f"{_HERE}{prefix}.{linked['$ref'].removeprefix(_HERE)}"
        return linked


def _slot(kind: str) -> str:
    return f"slot.{kind}"


def _with_use(options: dict[str, Any], name: str) -> dict[str, Any]:
    opened = copy.deepcopy(options)
    opened["properties"] = {"use": {"const": name}, **opened.get("properties", {})}
    opened["required"] = ["use", *opened.get("required", [])]
    return opened
