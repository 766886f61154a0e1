"""Number of threads of linear algebra, which affects the last digits of results.

Sums of a matrix product are split among the threads of BLAS, so another number of threads rounds
them differently. Runs and offline products therefore use one thread, or as many as the environment
variable SPARSEMOR_THREADS sets; the number is part of the key of a cached product and of a result.
"""

import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from sparsemor.core.errors import InputError
from sparsemor.core.notes import Note, information

VARIABLE = "SPARSEMOR_THREADS"


def threads() -> int:
    """Number of threads of BLAS and LAPACK in runs. Raises InputError if SPARSEMOR_THREADS is no
    whole number of at least 1."""
    given = os.environ.get(VARIABLE, "1")
    if not given.isdecimal() or not 1 <= len(given) <= 4 or int(given) < 1:
        raise InputError(f"{VARIABLE} must be a whole number of at least 1 (got {given!r})")
    return int(given)


@contextmanager
def fixed_threads() -> Iterator[None]:
    """Context in which BLAS and LAPACK use `threads()` threads, whatever the environment sets."""
    import_module("scipy.linalg")  # loads SciPy's BLAS library, which is limited then
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=threads(), user_api="blas"):
        yield


def limit_loaded_libraries() -> None:
    """Limits the threads of BLAS libraries loaded within a `fixed_threads` context, until it
    ends."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(limits=threads(), user_api="blas")


def elsewhere(kept: Mapping[str, Any]) -> tuple[Note, ...]:
    """Note that a run is continued on another processor, system or BLAS than in `kept`, the
    description stored with it; empty if it is not."""
    here = described()
    names = [n for n in ("machine", "system", "blas") if kept.get(n, here[n]) != here[n]]
    changed = [f"{n} was {_words(kept[n])} and is {_words(here[n])}" for n in names]
    return (information(
        f"continued elsewhere: {'; '.join(changed)}, so the last digits may differ from those of "
        "an uninterrupted run", "elsewhere"),) if changed else ()


def _words(value: Any) -> str:
    return ", ".join(value) if isinstance(value, list) else str(value)


def described() -> dict[str, Any]:
    """Processor, system, BLAS libraries and number of threads of a run, stored with its result."""
    from threadpoolctl import threadpool_info

    found = {f"{lib['internal_api']} {lib['version']}" for lib in threadpool_info()
             if lib["user_api"] == "blas"}
    return {"machine": platform.machine(), "system": platform.system(),
            "blas": sorted(found), "threads": threads()}
