"""Files of kept models, as commands take them instead of a scene (kind `prepared_model`)."""

from typing import TYPE_CHECKING

from sparsemor.core.results.model_file.first_line import is_model_file

if TYPE_CHECKING:
    from sparsemor.plugins.kept_models.reduced_model import ReducedModel


def load_model(path: str) -> "ReducedModel":
    """The model in a file (`sparsemor.load_model`)."""
    from sparsemor.plugins.kept_models.reduced_model import load_model as load

    return load(path)


__all__ = ["is_model_file", "load_model"]
