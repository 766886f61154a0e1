"""Choices by trial runs that scenes may leave open: the reducer, by `auto`, and points of training
runs, by `training.parameters.choice: greedy`."""

from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.registry.hooks import Manager
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache


def reducer(scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache) -> Scene:
    """Fields and reducer, by trial runs, where the reducer is `auto`."""
    if not scene.reducer.chooses:
        return scene
    from sparsemor.plugins.advice.advice import with_reducer

    return with_reducer(scene, cache, manager, body_cache)


def training_points(scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache) -> Scene:
    """Points of the training runs, by estimated errors, where their choice is `greedy`."""
    box = scene.training.parameters
    if box is None or box.points is not None or box.choice != "greedy":
        return scene
    trial = scene.reducer.trial_bases()
    own = () if trial is None else (trial.shared, *trial.others.values())
    # only a basis that learns from training runs depends on their points
    if not any(b.needs_snapshots for b in (*own, *scene.reducer.force_bases_used())):
        return scene
    from sparsemor.plugins.advice.greedy_training_points import with_points

    return with_points(scene, cache, manager, body_cache)
