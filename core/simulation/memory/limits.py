"""Memory of this process, and that of a run: peak, resident, estimate and limit. All in bytes."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import psutil

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
        return int(getattr(psutil.Process().memory_info(), "peak_wset", 0))
    most = int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    return most if sys.platform == "darwin" else 1024 * most


def resident() -> int:
    """Resident memory of this process, bytes."""
    return int(psutil.Process().memory_info().rss)


def ceiling() -> int:
    """Memory limit of this process, bytes: resident memory plus the memory still available on the
    machine and in each enclosing control group; at most SPARSEMOR_MEMORY."""
    spare = [int(psutil.virtual_memory().available), *(limit - used for limit, used in _groups())]
    limit, given = resident() + max(min(spare), 0), _given()
    return limit if given is None else min(limit, given)


def machine_memory() -> int:
    """Total memory of the machine or of the control group, bytes, at most SPARSEMOR_MEMORY. Unlike
    `ceiling` it does not change from one moment to the next."""
    total, given = int(psutil.virtual_memory().total), _given()
    return min([total, *(limit for limit, _ in _groups()), *([] if given is None else [given])])


def _given() -> int | None:
    """Limit, bytes, by the environment variable LIMIT, in GB; None without."""
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
        # names of version 2, then of version 1, where no limit is a number of 2**60 or more
        for limit, used in (("memory.max", "memory.current"),
                            ("memory.limit_in_bytes", "memory.usage_in_bytes")):
            most, now = _number(folder / limit), _number(folder / used)
            if most is not None and now is not None and most < 2**60:
                # pages of files that nobody needs at the moment are given up first
                immobile = _mentioned(folder / "memory.stat", "inactive_file", 1) or 0
                found.append((most, max(now - immobile, 0)))
    return found


def _folders() -> list[Path]:
    """Folders of the control groups of this process and of their parents, which have limits of
    their own: version 2, and version 1 with a hierarchy for memory."""
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
    """Number in a file; None without the file, or for the text "max" (no limit)."""
    try:
        return int(file.read_text())
    except (OSError, ValueError):  # no such group, or "max"
        return None


def _mentioned(file: str | Path, name: str, unit: int) -> int | None:
    """Number after a name in a file of lines `name: number`, times `unit`; None if it is not
    there."""
    try:
        for line in Path(file).read_text().splitlines():
            words = line.replace(":", " ").split()
            if words and words[0] == name:
                return int(words[1]) * unit
    except (OSError, ValueError, IndexError):
        pass
    return None


def gb(size: float) -> str:
    """Size in bytes as GB for messages."""
    if size >= 1e6 * GIGABYTE:
        return f"{size / GIGABYTE:.3g} GB"
    return f"{size / GIGABYTE:.0f} GB" if size >= 10 * GIGABYTE else f"{size / GIGABYTE:.2g} GB"


@dataclass(frozen=True, slots=True)
class MemoryUse:
    """Memory of a run, bytes. expected: estimated total, None without an estimate; offline: peak
    until the first step."""

    expected: float | None
    offline: int

    def summary(self) -> dict[str, float]:
        """Summary entries, GB. peak_gb: peak of the process; peak_offline_gb: its peak until the
        first step; expected_gb: estimate in advance; available_gb: memory limit of the process at
        the end of the run."""
        expected = {} if self.expected is None else {"expected_gb": self.expected / GIGABYTE}
        return {"peak_gb": peak() / GIGABYTE, "peak_offline_gb": self.offline / GIGABYTE,
                **expected, "available_gb": ceiling() / GIGABYTE}
