"""What scenes leave to trial runs, such as the reducer, made explicit before a run by the functions
to which entry points of the group `sparsemor.choice` refer."""

from sparsemor.core.errors import InputError
from sparsemor.core.model.body_cache import BodyCache
from sparsemor.core.registry.hooks import Manager
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache

CHOICE = "choice"
"""Kind of these functions: scene, cache, manager of events and built bodies -> the scene with what
is chosen and notes on that, or the same scene if it leaves nothing to choose."""


def explicit(
    scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache | None = None
) -> Scene:
    """The scene with all that is chosen for it. Raises InputError and SolveFailed as trial runs
    do."""
    registry = scene.source.registry
    for plugin in registry.names(CHOICE):
        choose = registry.load(CHOICE, registry.spelling(plugin))
        made = choose(scene, cache, manager, body_cache or BodyCache())
        if not isinstance(made, Scene):
            raise InputError(f"choice {plugin.name!r} returned no scene: report it to the authors "
                             f"of {plugin.distribution}")
        scene = made
    return scene
