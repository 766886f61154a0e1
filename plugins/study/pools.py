"""Worker pools of a study: this process, or other processes (core/simulation/workers/local_pool.py,
dask_pool.py)."""

from collections import deque
from typing import Protocol

from sparsemor.core.registry.registry import Registry
from sparsemor.core.simulation.workers.local_pool import EndedJob, Payload
from sparsemor.plugins.study.jobs import execute
from sparsemor.plugins.study.kept_models import KeptModels


class Pool(Protocol):
    """Workers that execute the jobs of a study.

    workers: number of workers for the table (0: this process); slots: maximum number of submitted
    jobs; repeats: how often a job is repeated by another submission after its worker died; lost:
    number of workers that died so far.
    """

    @property
    def workers(self) -> int: ...
    @property
    def slots(self) -> int: ...
    @property
    def repeats(self) -> int: ...
    @property
    def lost(self) -> int: ...
    def submit(self, name: str, job: Payload) -> None: ...
    def next(self, timeout: float) -> EndedJob | None:
        """Next completed job, or None after `timeout` s."""
        ...

    def close(self) -> None:
        """Stops all workers, including running jobs."""
        ...


class SerialPool:
    """Pool without workers: jobs are executed one after the other in this process."""

    workers, slots, repeats, lost = 0, 1, 0, 0

    def __init__(self, registry: Registry | None = None) -> None:
        self._registry, self._models = registry, KeptModels()
        self._waiting: deque[tuple[str, Payload]] = deque()

    def submit(self, name: str, job: Payload) -> None:
        self._waiting.append((name, job))

    def next(self, timeout: float) -> EndedJob | None:
        if not self._waiting:
            return None
        name, job = self._waiting.popleft()
        return EndedJob(name, execute(job, self._registry, self._models))

    def close(self) -> None:
        self._waiting.clear()
