"""Worker pools of a study: this process, processes on this machine
(core/simulation/workers/local_pool.py), or an existing dask.distributed cluster."""

import json
import os
import queue
import threading
from collections import Counter, deque
from pathlib import Path
from typing import Any, Protocol, cast
from urllib.parse import urlsplit

from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.run_identity import code_digest
from sparsemor.core.simulation.workers.local_pool import EndedJob, Payload
from sparsemor.plugins.study.jobs import DIED, execute, shared_model

SECONDS = 10.0
"""Timeout of the connection to the scheduler, s."""
_one_job = threading.Lock()


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
        self._registry = registry
        self._waiting: deque[tuple[str, Payload]] = deque()

    def submit(self, name: str, job: Payload) -> None:
        self._waiting.append((name, job))

    def next(self, timeout: float) -> EndedJob | None:
        if not self._waiting:
            return None
        name, job = self._waiting.popleft()
        return EndedJob(name, execute(job, self._registry))

    def close(self) -> None:
        self._waiting.clear()
        shared_model.cache_clear()


class DaskPool:
    """Pool that executes jobs as tasks of a dask cluster; dask itself repeats the jobs of a lost
    worker, as often as its setting `allowed-failures` says.

    scheduler: address of the cluster's scheduler, path of its scheduler file, or a `Client` or
    `Cluster` object, which stays open. Raises InputError if no scheduler responds or
    dask.distributed is not installed.
    """

    repeats = 0

    def __init__(self, scheduler: Any) -> None:
        self._client = _connected(scheduler)
        self._ended: queue.Queue[tuple[str, Any]] = queue.Queue()
        self._futures: dict[str, Any] = {}
        self._deaths: Counter[str] = Counter()
        self.lost = 0
        self._client.subscribe_topic("all", self._heard)

    @property
    def workers(self) -> int:
        """Current number of workers in the cluster."""
        return len(self._client.nthreads())

    @property
    def slots(self) -> int:
        # one for each worker: dask holds a dead worker against the jobs that wait for it, too
        return max(self.workers, 1)

    def submit(self, name: str, job: Payload) -> None:
        future = self._client.submit(_execute, code_digest(), dict(job), key=self._key(name),
                                     pure=False)
        self._futures[name] = future
        future.add_done_callback(lambda f: self._ended.put((name, f)))

    def next(self, timeout: float) -> EndedJob | None:
        """The next job that ends, with the number of workers that died of it; None after `timeout`,
        s."""
        try:
            name, future = self._ended.get(timeout=timeout)
        except queue.Empty:
            return None
        del self._futures[name]
        deaths = self._deaths[self._key(name)]
        if future.status == "finished":
            return EndedJob(name, future.result(), deaths=deaths)
        error = future.exception() if future.status == "error" else None
        from distributed.scheduler import KilledWorker

        if isinstance(error, KilledWorker):  # whose last event may arrive after it
            return EndedJob(name, None, f"worker {error.last_worker.address} is lost",
                            deaths=max(deaths, error.allowed_failures + 1))
        reason = f"{type(error).__name__}: {error}" if error else future.status
        return EndedJob(name, {"status": DIED, "message": f"its worker failed ({reason})"},
                        deaths=deaths)

    def close(self) -> None:
        self._client.cancel(list(self._futures.values()))
        self._client.close()

    def _key(self, name: str) -> str:
        return f"sparsemor-{id(self)}-{name}"

    def _heard(self, event: tuple[float, Any]) -> None:
        """Counts lost workers by the scheduler's events."""
        what = event[1]
        if isinstance(what, dict) and what.get("action") == "remove-worker":
            self.lost += not what.get("expected", False)
            self._deaths.update([*what["processing-tasks"], *what["lost-computed-tasks"]])


def _execute(code: str, job: Payload) -> dict[str, Any]:
    """Executes a job in a worker, one at a time: the threads of a worker share the number of
    threads of BLAS, on which the last digits depend."""
    if code_digest() != code:
        raise RuntimeError("this worker has another version of sparsemor")
    with _one_job:
        return execute(job)


def _connected(scheduler: Any) -> Any:
    """Client of our own at the scheduler that is given by its address, its scheduler file, a
    `Client` or a `Cluster`. Raises InputError if none responds."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError("a cluster needs the extra `dask`: pip install 'sparsemor[dask]'",
                         "scheduler") from None
    options: dict[str, Any] = {"timeout": SECONDS, "set_as_default": False}
    try:
        if isinstance(scheduler, Client):
            if scheduler.status != "running":
                raise ValueError(f"the client is {scheduler.status}")
            given = cast(Any, scheduler)
            options["security"], scheduler = given.security, given.scheduler.address
        elif isinstance(scheduler, str | os.PathLike):
            scheduler = _address(os.fspath(scheduler))
        return cast(Any, Client)(scheduler, **options)  # which has no types
    except (OSError, ValueError, TypeError, RuntimeError) as error:  # TimeoutError is an OSError
        raise InputError(f"no scheduler responds at {scheduler} ({error})", "scheduler") from None


def _address(text: str) -> str:
    """Address of a scheduler: the text, or what a scheduler file of that name has in it (`dask
    scheduler --scheduler-file`)."""
    if "://" in text or _port(f"tcp://{text}") is not None:
        # looked at here: a client that cannot read its address prints a traceback when it goes
        if _port(text if "://" in text else f"tcp://{text}") is None:
            raise ValueError("an address is tcp://host:port")
        return text
    try:
        return str(json.loads(Path(text).read_text(encoding="utf-8"))["address"])
    except OSError:
        raise InputError(f"{text} is neither an address (tcp://host:port) nor a scheduler file",
                         "scheduler") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"{text} is not a scheduler file of dask", "scheduler") from None


def _port(address: str) -> int | None:
    try:
        return urlsplit(address).port
    except ValueError:
        return None
