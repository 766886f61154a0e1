"""Execution of study jobs on an existing dask.distributed cluster."""

import queue
from typing import Any, cast
from urllib.parse import urlsplit

from sparsemor.core.errors import InputError
from sparsemor.core.simulation.workers.local_pool import EndedJob, Payload
from sparsemor.plugins.study.jobs import execute

SECONDS = 10.0
"""Timeout of the connection to the scheduler, s."""


class DaskPool:
    """Pool that executes jobs as tasks of the dask cluster at `address`; dask itself repeats the
    jobs of a lost worker.

    Raises InputError if no scheduler responds or dask.distributed is not installed.
    """

    repeats = 0

    def __init__(self, address: str) -> None:
        self._client = _connected(address)
        self._ended: queue.Queue[tuple[str, Any]] = queue.Queue()
        self._futures: dict[str, Any] = {}

    @property
    def workers(self) -> int:
        """Current number of threads in the cluster."""
        return sum(int(n) for n in self._client.nthreads().values())

    @property
    def slots(self) -> int:
        # more than there are workers: those that join on the way find work waiting
        return max(2 * self.workers, 8)

    def submit(self, name: str, job: Payload) -> None:
        future = self._client.submit(execute, dict(job), key=f"sparsemor-{id(self)}-{name}",
                                     pure=False)
        self._futures[name] = future
        future.add_done_callback(lambda f: self._ended.put((name, f)))

    def next(self, timeout: float) -> EndedJob | None:
        try:
            name, future = self._ended.get(timeout=timeout)
        except queue.Empty:
            return None
        del self._futures[name]
        if future.status == "finished":
            return EndedJob(name, future.result())
        error = future.exception() if future.status == "error" else None
        return EndedJob(name, None, f"{type(error).__name__}: {error}" if error else future.status)

    def close(self) -> None:
        self._client.cancel(list(self._futures.values()))
        self._client.close()


def _connected(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise InputError("a cluster needs the extra `dask`: pip install 'sparsemor[dask]'",
                         "scheduler") from None
    try:
        # looked at first: a client that cannot read its address prints a traceback when it goes
        if urlsplit(address if "://" in address else f"tcp://{address}").port is None:
            raise ValueError("an address is tcp://host:port")
        client = cast(Any, Client)  # which has no types
        return client(address, timeout=SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        raise InputError(f"no scheduler responds at {address} ({error})", "scheduler") from None
