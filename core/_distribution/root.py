"""sparsemor: sparse, projection-free model order reduction of thermomechanical multibody systems.

    from sparsemor import load, simulate, compare, study
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sparsemor.core.errors import InputError as InputError
    from sparsemor.core.registry.registry import Registry as Registry
    from sparsemor.core.results.run_result import open_result as open_result
    from sparsemor.core.scene.scene import Scene as Scene
    from sparsemor.core.scene.scene import load as load
    from sparsemor.core.simulation.simulate import simulate as simulate
    from sparsemor.core.status import SolveFailed as SolveFailed
    from sparsemor.core.status import Status as Status
    from sparsemor.plugins.advice.advice import Advice as Advice
    from sparsemor.plugins.advice.advice import advise as advise
    from sparsemor.plugins.analyses.solve import solve as solve
    from sparsemor.plugins.charts import plot as plot
    from sparsemor.plugins.charts.animation import animate as animate
    from sparsemor.plugins.comparison.compare import compare as compare
    from sparsemor.plugins.export import export as export
    from sparsemor.plugins.kept_models.reduced_model import ReducedModel as ReducedModel
    from sparsemor.plugins.kept_models.reduced_model import load_model as load_model
    from sparsemor.plugins.kept_models.reduced_model import reduce as reduce
    from sparsemor.plugins.liang2026.reproduce import reproduce as reproduce
    from sparsemor.plugins.study import study as study
    from sparsemor.plugins.study.parameter_test import parameter_test as parameter_test

    __version__: str

_HOMES = {
    "Advice": "plugins.advice.advice",
    "InputError": "core.errors",
    "ReducedModel": "plugins.kept_models.reduced_model",
    "Registry": "core.registry.registry",
    "Scene": "core.scene.scene",
    "SolveFailed": "core.status",
    "Status": "core.status",
    "advise": "plugins.advice.advice",
    "animate": "plugins.charts.animation",
    "compare": "plugins.comparison.compare",
    "export": "plugins.export",
    "load": "core.scene.scene",
    "load_model": "plugins.kept_models.reduced_model",
    "open_result": "core.results.run_result",
    "parameter_test": "plugins.study.parameter_test",
    "plot": "plugins.charts",
    "reduce": "plugins.kept_models.reduced_model",
    "reproduce": "plugins.liang2026.reproduce",
    "simulate": "core.simulation.simulate",
    "solve": "plugins.analyses.solve",
    "study": "plugins.study",
}

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    # names are imported when they are asked for, so that importing the package stays quick
    if name == "__version__":
        from importlib.metadata import version

        return version("sparsemor")
    if name in _HOMES:
        return getattr(import_module(f"sparsemor.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'sparsemor' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
