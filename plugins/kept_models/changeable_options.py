"""Options of a scene that a run of its prepared model may change."""

from collections.abc import Mapping
from typing import Any

from sparsemor.core.protocols.time_function import TimeFunction
from sparsemor.core.scene.option_tree import functions_of_time
from sparsemor.core.scene.overrides import find
from sparsemor.core.scene.scene import Scene

FREE = ("title", "output", "time.end")
"""Keys of a scene on which no prepared model depends."""


def load_functions(scene: Scene) -> Mapping[str, TimeFunction]:
    """Key -> function of time of the loads, on which a model need not depend."""
    return dict(functions_of_time({"loads": scene.loads}))


def kept_options(scene: Scene, parameters: bool = False) -> Mapping[str, object]:
    """Options of a scene as plain data, with None for those that a run of its model may change.
    parameters: also for the values of its parameters, with which its equations are projected
    again."""
    tree = scene.dump()
    declared = [k for p in scene.parameters.values() for k in p.keys] if parameters else []
    for key in (*declared, *FREE, *load_functions(scene)):
        node: Any = tree
        *path, last = find(tree, key)
        for part in path:
            node = node[part]
        node[last] = None
    return tree
