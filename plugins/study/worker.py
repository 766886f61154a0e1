"""Worker process of a study (`python -m` this module)."""

from functools import partial

from sparsemor.core.simulation.workers.serve import Execute, serve


def executing() -> Execute:
    """Execution of the jobs of a study, with the models that earlier ones have prepared."""
    from sparsemor.plugins.study.jobs import execute
    from sparsemor.plugins.study.kept_models import KeptModels

    return partial(execute, models=KeptModels())


if __name__ == "__main__":
    serve(executing)
