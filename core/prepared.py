"""What a run starts from: its checked model and its offline products, the rigid stage included."""

from sparsemor.core.cache import Cache
from sparsemor.core.checks import checked_model
from sparsemor.core.estimate import fitting
from sparsemor.core.hooks import Manager
from sparsemor.core.model import Model
from sparsemor.core.offline import Offline, offline_of
from sparsemor.core.products import Products
from sparsemor.core.rigid_stage import staged
from sparsemor.core.scene import Scene
from sparsemor.core.workshop import Workshop


def prepared(
    scene: Scene, cache: Cache, manager: Manager, shop: Workshop | None = None
) -> tuple[Model, Offline]:
    """The model that a reducer is prepared for. A rigid stage is run here, or found in the cache.

    Raises InputError as `checked_model` does, and where the run would not fit in memory;
    SolveFailed where the rigid stage stops early.
    """
    shop, products = shop or Workshop(), Products(cache)
    if scene.rigid_stage is None:
        model = checked_model(scene, shop)
    else:
        checked_model(scene, shop)  # which is not held beside the one that is run
        model = staged(scene, products, manager, shop)
    offline = offline_of(scene, model, products, manager, shop)
    offline.expected = fitting(scene, model, offline)
    return model, offline
