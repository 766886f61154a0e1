"""Prepared models that the runs of a study share in one process."""

from collections import OrderedDict
from collections.abc import Callable

from sparsemor.core.errors import InputError
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.reduced_model import ReducedModel, reduce
from sparsemor.core.status import SolveFailed

KEPT = 4
"""Number of models that are kept at once."""


class KeptModels:
    """Reduced models by key, the last few; each is prepared once."""

    def __init__(self) -> None:
        self._models: OrderedDict[str, ReducedModel | None] = OrderedDict()

    def of(self, key: str, base: Callable[[], Scene], scene: Scene) -> ReducedModel | None:
        """Model that the run of a scene may use; None if it needs its own. base: scene from which
        the model is prepared, whatever run comes first."""
        if key not in self._models:
            self._models[key] = _reduced(base())
            while len(self._models) > KEPT:
                self._models.popitem(last=False)
        self._models.move_to_end(key)
        model = self._models[key]
        try:
            if model is not None:
                model.check(scene)
        except InputError:
            return None
        return model


def _reduced(scene: Scene) -> ReducedModel | None:
    try:
        model = reduce(scene)
        return None if model.estimates_errors else model  # which runs with other loads do not
    except (InputError, SolveFailed):  # each run reports its own failure
        return None
