"""Execution of independent calls in worker processes, some of them after others."""

import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, parent_process
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")
ATTEMPTS = 2
"""Number of times that a call is started if worker processes die."""


def executed(
    function: Callable[[T], R], calls: Mapping[str, T], workers: int,
    after: Mapping[str, str] | None = None, lost: Callable[[str], R] | None = None,
) -> Iterator[tuple[str, R]]:
    """Name and result of function(argument) for each call, in the order in which they end.

    workers: number of processes; 0 or 1: in this process, in order. after: call -> call that must
    have ended before. lost: result of a call whose process died twice; otherwise
    BrokenProcessPool is raised.
    """
    waits = {name: first for name, first in (after or {}).items() if first in calls}
    if workers <= 1:
        for name in _ordered(list(calls), waits):
            yield name, function(calls[name])
        return
    left, attempts = dict(calls), dict.fromkeys(calls, 0)
    while left:
        try:
            for name, result in _round(function, left, workers, waits, attempts):
                del left[name]
                yield name, result
        except BrokenProcessPool:
            spent = [name for name in left if attempts[name] >= ATTEMPTS]
            if lost is None:
                raise
            for name in spent:
                del left[name]
                yield name, lost(name)


def _round(
    function: Callable[[T], R], calls: Mapping[str, T], workers: int, after: Mapping[str, str],
    attempts: dict[str, int],
) -> Iterator[tuple[str, R]]:
    """Results of the calls as one pool of processes returns them."""
    waiting, running = dict(calls), dict[Future[R], str]()
    left = set(calls)
    pool = ProcessPoolExecutor(
        workers, mp_context=get_context("spawn"), initializer=_end_with_parent)
    try:
        while waiting or running:
            for name in [n for n in waiting if after.get(n) not in left]:
                if len(running) < workers:  # so that only calls that run are counted as started
                    attempts[name] += 1
                    running[pool.submit(function, waiting.pop(name))] = name
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                name = running.pop(future)
                result = future.result()
                left.discard(name)
                yield name, result
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _end_with_parent() -> None:
    """Ends this worker process when the process that started it is killed, so that the same
    command can be given again at once."""
    parent = parent_process()
    assert parent is not None

    def wait_for_end() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait_for_end, daemon=True).start()


def _ordered(names: Sequence[str], after: Mapping[str, str]) -> list[str]:
    """Names with those that others wait for first."""
    return sorted(names, key=lambda n: n in after)
