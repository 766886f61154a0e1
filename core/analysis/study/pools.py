"""Pools of workers: this process, or others (local_pool.py, dask_pool.py)."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from sparsemor.core.analysis.study.jobs import execute
from sparsemor.core.registry.registry import Registry

Payload = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Ended:
    """A job's answer, or how its worker died (then `answer` is None)."""

    name: str
    answer: dict[str, Any] | None
    death: str = ""


class Pool(Protocol):
    """workers: how many, as the table says it (0: this process); slots: jobs it takes at a time;
    repeats: how often a job is given out again whose worker died."""

    @property
    def workers(self) -> int: ...
    @property
    def slots(self) -> int: ...
    @property
    def repeats(self) -> int: ...
    def submit(self, name: str, job: Payload) -> None: ...
    def next(self, timeout: float) -> Ended | None:
        """The next end of a job, or None after `timeout` s."""
        ...

    def close(self) -> None:
        """Stop, with whatever is running."""
        ...


class SerialPool:
    """The jobs run in this process, one after the other."""

    workers, slots, repeats = 0, 1, 0

    def __init__(self, registry: Registry | None = None) -> None:
        self._registry = registry
        self._waiting: deque[tuple[str, Payload]] = deque()

    def submit(self, name: str, job: Payload) -> None:
        self._waiting.append((name, job))

    def next(self, timeout: float) -> Ended | None:
        if not self._waiting:
            return None
        name, job = self._waiting.popleft()
        return Ended(name, execute(job, self._registry))

    def close(self) -> None:
        self._waiting.clear()
