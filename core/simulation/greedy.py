"""Greedy choice of training runs in the box of parameters: where a run of the reduced model
estimates the largest error, a full-order run is added to its training."""

from collections.abc import Mapping
from math import inf, isfinite
from typing import Any

import numpy as np

from sparsemor.core.errors import InputError
from sparsemor.core.model.body_cache import BodyCache
from sparsemor.core.registry.hooks import Manager
from sparsemor.core.results.error_norms import estimated_errors
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.parameters import Point
from sparsemor.core.scene.run_identity import Identity
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.status import SolveFailed

EVERY = 10
"""Steps from one estimate of the error to the next, unless the reducer has another number."""


def greedy_points(
    scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache
) -> list[Point]:
    """Points of the training runs of a scene with `training.parameters.choice: greedy`, cached.

    Each candidate is run by the reduced model of the points chosen so far, with its error estimate;
    that with the largest estimate of any block is added, until it is at most the tolerance. A run
    that fails counts as an infinite error. Raises InputError for a reducer without error estimate.
    """
    box = scene.training.parameters
    assert box is not None
    names = list(scene.parameters)

    def make() -> Mapping[str, Any]:
        points, found = box.chosen(scene.parameters), []
        candidates = box.others(scene.parameters)
        while len(points) < box.runs(scene.parameters):
            errors = _estimates(scene, points, candidates, cache, body_cache)
            worst = int(np.argmax(errors))
            found.append(errors[worst])
            if errors[worst] <= box.tolerance or candidates[worst] in points:
                break
            points.append(candidates[worst])
        return {"points": np.array([[p[n] for n in names] for p in points]),
                "errors": np.array(found)}

    key = digest(scene.digest(), Identity.of(scene).plain())
    arrays = Products(cache).remember("greedy", key, make)
    return [dict(zip(names, map(float, row), strict=True)) for row in np.asarray(arrays["points"])]


def _estimates(
    scene: Scene, points: list[Point], candidates: list[Point], cache: Cache, body_cache: BodyCache
) -> list[float]:
    """Largest estimated error of any block, relative to its largest change, at each candidate."""
    from sparsemor.core.simulation.reduced_model import reduce  # which prepares runs by this choice

    every = getattr(scene.reducer, "error_estimate", 0) or EVERY
    try:
        trial = scene.using({
            "training.parameters": {"points": [dict(p) for p in points]},
            "reducer.error_estimate": every, "check_stability": "off"}, label="greedy")
    except InputError as error:
        raise InputError(f"greedy needs estimated errors: {error}",
                         "training.parameters.choice") from None
    model, found = reduce(trial, cache=cache, body_cache=body_cache), []
    for point in candidates:
        try:
            errors = estimated_errors(model.at(point).run())
        except SolveFailed:
            found.append(inf)
            continue
        if not errors:
            raise InputError("greedy needs estimated errors, which no block of this scene has: "
                             "take latin_hypercube or corners", "training.parameters.choice")
        worst = max(float(e.max()) for e in errors.values())
        found.append(worst if isfinite(worst) else inf)
    return found
