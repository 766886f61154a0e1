"""Memory of this process: peak, resident, and limit. All in bytes."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sparsemor.core.errors import InputError

LIMIT = "SPARSEMOR_MEMORY"
"""Environment variable with the memory limit of one process of a run, GB."""
GIGABYTE = 1e9


def peak() -> int:
    """Peak resident memory of this process, bytes, mapped files included; 0 if the system does not
    report it.

    Linux reports it in /proc; its value from `getrusage` begins with the size of the parent
    process.
    """
    own = _mentioned("/proc/self/status", "VmHWM", 1024)
    if own is not None:
        return own
    try:
        import resource
    except ImportError:  # Windows
        return 0
    most = int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    return most if sys.platform == "darwin" else 1024 * most


def resident() -> int:
    """Resident memory of this process, bytes; its peak if the system does not report it."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return peak()
    return pages * os.sysconf("SC_PAGE_SIZE")


@contextmanager
def bounded_address_space(extra: int) -> Iterator[None]:
    """Context that limits the address space of this process to its present size and `extra` bytes:
    larger allocations raise MemoryError. Without effect on systems that have no such limit."""
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
        before = resource.getrlimit(resource.RLIMIT_AS)
        limits = [pages * resource.getpagesize() + extra,
                  *(v for v in before if v != resource.RLIM_INFINITY)]
        resource.setrlimit(resource.RLIMIT_AS, (min(limits), before[1]))
    except (ImportError, OSError, ValueError, IndexError):
        yield
        return
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def ceiling() -> int:
    """Memory limit of this process, bytes: resident memory plus the memory still available on the
    machine and in each enclosing control group; at most SPARSEMOR_MEMORY."""
    spare = [_mentioned("/proc/meminfo", "MemAvailable", 1024)]
    spare += [limit - used for limit, used in _groups()]
    known = [s for s in spare if s is not None]
    own = [] if (given := _given()) is None else [given]
    if known:
        own.append(resident() + max(min(known), 0))
    return min(own, default=machine_memory())


def machine_memory() -> int:
    """Total memory of the machine or of the control group, bytes, at most SPARSEMOR_MEMORY. Unlike
    `ceiling` it does not change from one moment to the next."""
    found = [limit for limit, _ in _groups()]
    given = _given()
    if given is not None:
        found.append(given)
    try:
        found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (ValueError, OSError, AttributeError):
        if not found:
            raise InputError(f"the memory of this machine cannot be determined: set {LIMIT}, in "
                             "GB") from None
    return min(found)


def _given() -> int | None:
    text = os.environ.get(LIMIT)
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e9:
        raise InputError(f"{LIMIT} must be a number of GB above 0 (got {text!r})")
    return int(value * GIGABYTE)


def _groups() -> list[tuple[int, int]]:
    """Limit and use, bytes, of each control group (cgroup) of this process that has a memory
    limit."""
    found = []
    for folder in _folders():
        for limit, used in (("memory.max", "memory.current"),
                            ("memory.limit_in_bytes", "memory.usage_in_bytes")):
            most, now = _number(folder / limit), _number(folder / used)
            if most is not None and now is not None and most < 2**60:
                # pages of files that nobody needs at the moment are given up first
                immobile = _mentioned(folder / "memory.stat", "inactive_file", 1) or 0
                found.append((most, max(now - immobile, 0)))
    return found


def _folders() -> list[Path]:
    root = Path("/sys/fs/cgroup")
    found = [root, root / "memory"]
    try:
        lines = Path("/proc/self/cgroup").read_text().splitlines()
    except OSError:
        return found
    for line in lines:
        _, controllers, path = line.split(":", 2)
        base = root / "memory" if "memory" in controllers.split(",") else root
        own = base / path.lstrip("/")
        found += [own, *(p for p in own.parents if base in p.parents)]
    return list(dict.fromkeys(found))


def _number(file: Path) -> int | None:
    try:
        return int(file.read_text())
    except (OSError, ValueError):  # no such group, or "max"
        return None


def _mentioned(file: str | Path, name: str, unit: int) -> int | None:
    try:
        for line in Path(file).read_text().splitlines():
            words = line.replace(":", " ").split()
            if words and words[0] == name:
                return int(words[1]) * unit
    except (OSError, ValueError, IndexError):
        pass
    return None


def gb(size: float) -> str:
    if size >= 1e6 * GIGABYTE:
        return f"{size / GIGABYTE:.3g} GB"
    return f"{size / GIGABYTE:.0f} GB" if size >= 10 * GIGABYTE else f"{size / GIGABYTE:.2g} GB"
