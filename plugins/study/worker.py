"""Worker process of a study (`python -m` this module)."""

from sparsemor.core.simulation.workers.worker_loop import Execute, serve


def executing() -> Execute:
    """Execution of the jobs of a study, which is imported when the process listens."""
    from sparsemor.plugins.study.jobs import execute

    return execute


if __name__ == "__main__":
    serve(executing)
