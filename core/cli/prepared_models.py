"""Files of prepared models, which commands take instead of a scene. They are read by plugins of the
kind `prepared_model`."""

from collections.abc import Sequence
from os.path import isfile
from pathlib import Path
from typing import Protocol

from sparsemor.core.registry.registry import Registry
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene

KIND = "prepared_model"


class PreparedModel(Protocol):
    """A model that was prepared before, and runs without what its preparation needs."""

    @property
    def scene(self) -> Scene:
        """Scene from which it was prepared."""
        ...

    def check(self, overrides: Scene) -> None:
        """Raises InputError for a scene that it cannot run."""
        ...

    def run(self, overrides: Scene, *, out: Path, observers: Sequence[object]) -> RunResult:
        """Result of its run of a scene, stored under `out`."""
        ...


class ModelFiles(Protocol):
    """Files of one format: entry points of the kind refer to a module or an object of this form."""

    def is_model_file(self, path: Path) -> bool:
        """True for a file of the format, of any version."""
        ...

    def load_model(self, path: str) -> PreparedModel:
        """The model in a file. Raises InputError for one that cannot be used."""
        ...


def format_of(path: str) -> ModelFiles | None:
    """Format of a file of a prepared model; None for anything else, such as a scene."""
    if not isfile(path):  # most commands name a packaged scene
        return None
    registry = Registry()
    formats = (registry.load(KIND, registry.spelling(p)) for p in registry.names(KIND))
    return next((f for f in formats if f.is_model_file(Path(path))), None)
