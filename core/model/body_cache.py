"""Cache of built bodies and models, shared by check, pre-simulation, training and steps."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from sparsemor.core.protocols import Body, BodyPlugin, CopiesRigidly, SelectsFields
from sparsemor.core.registry.plugin import Plugin

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
    """Bodies as their plugins build them, found again by name, options and folder.

    Meshing and element integrals are most of what assembly costs, and do not depend on the motion
    that a stage gives. A body that is requested without its fields, as by a rigid stage, is made
    from one that has them by its method `rigid_copy()`, where it has one.
    """

    _bodies: list[_Built] = field(default_factory=list)
    _models: dict[str, "Model"] = field(default_factory=dict)

    def body(self, plugin: BodyPlugin, name: str, base: Path) -> Body:
        """The body that `plugin.build(name, base)` makes; InputError as it raises."""
        mine = [b for b in self._bodies if b.name == name and b.base == base]
        for b in mine:
            if b.plugin == plugin:
                return b.body
        whole = next((b.body for b in mine if without_fields(b.plugin) == plugin), None)
        body = whole.rigid_copy() if isinstance(whole, CopiesRigidly) else plugin.build(name, base)
        self._bodies.append(_Built(name, plugin, base, body))
        return body

    def model(self, key: str, make: Callable[[], "Model"]) -> "Model":
        """The model that goes by this key, made when it is first asked for."""
        if key not in self._models:
            self._models[key] = make()
        return self._models[key]


def without_fields(plugin: BodyPlugin) -> BodyPlugin | None:
    """The same body plugin with `fields: []`; None where it has no such option, or none set."""
    if not (isinstance(plugin, Plugin) and isinstance(plugin, SelectsFields) and plugin.fields):
        return None
    return plugin.model_copy(update={"fields": []})
