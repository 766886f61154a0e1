"""Cache of built bodies and models, shared by input check, pre-simulation, training run and main
run."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from sparsemor.core.protocols import Body, BodyPlugin

if TYPE_CHECKING:
    from sparsemor.core.model.model import Model


@dataclass(frozen=True, slots=True)
class _Built:
    name: str
    plugin: BodyPlugin
    base: Path
    body: Body


@dataclass(slots=True)
class BodyCache:
    """Cache of built bodies, keyed by name, options and folder, and of assembled models.

    Meshing and element integrals dominate the cost of assembly and do not depend on a prescribed
    motion. A rigid copy of a body, as the rigid-body pre-simulation uses, is made from the cached
    flexible body if that has one (`Body.rigid_copy`).
    """

    _bodies: list[_Built] = field(default_factory=list)
    models: dict[str, "Model"] = field(default_factory=dict)

    def body(self, plugin: BodyPlugin, name: str, base: Path) -> Body:
        """The body that `plugin.build(name, base)` returns, from the cache if possible. Raises the
        InputError of `build`."""
        mine = [b for b in self._bodies if b.name == name and b.base == base]
        for b in mine:
            if b.plugin == plugin:
                return b.body
        whole = next((b.body for b in mine if without_fields(b.plugin) == plugin), None)
        body = (None if whole is None else whole.rigid_copy()) or plugin.build(name, base)
        self._bodies.append(_Built(name, plugin, base, body))
        return body

    def of_bodies(self) -> "BodyCache":
        """Cache with the same bodies, and without the models."""
        return BodyCache(self._bodies)


def without_fields(plugin: BodyPlugin) -> BodyPlugin | None:
    """Options of the same body without elastic and thermal fields (`fields: []`); None for a body
    without this option, or without fields."""
    if not plugin.selected_fields:
        return None
    return plugin.model_copy(update={"fields": []})
