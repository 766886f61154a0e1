"""Command `sparsemor doctor`: what is installed, with which kernels and threads runs compute, and
what the cache keeps."""

import os
import platform
import re
from collections import Counter
from collections.abc import Iterator
from importlib import metadata
from typing import Any

from sparsemor.core.cli.exit_codes import print_json
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.plugin import OWN
from sparsemor.core.registry.registry import Registry
from sparsemor.plugins.command_line.options import Json

DEVELOPMENT = {"test", "lint", "docs"}
"""Extras that no user needs."""
_NAME = re.compile(r"[A-Za-z0-9][\w.-]*")


def doctor(as_json: Json = False) -> None:
    """Report what is installed: versions, extras, kernels and threads of linear algebra, cache."""
    found = facts()
    if as_json:
        print_json(found)
        return
    from rich.console import Console
    from rich.table import Column, Table
    from rich.text import Text

    extras = {name: "yes" if not missing else f"no ({', '.join(missing)})"
              for name, missing in found["extras"].items()}
    rows = {
        "sparsemor": f"{found['sparsemor']}, Python {found['python']}, {found['system']}",
        "packages": ", ".join(f"{n} {v}" for n, v in found["packages"].items()),
        "missing": ", ".join(found["missing"]) or "none",
        "extras": ", ".join(n for n, v in extras.items() if v == "yes") or "none",
        "not installed": ", ".join(f"{n} {v.removeprefix('no ')}" for n, v in extras.items()
                                   if v != "yes") or "none",
        "plugins": ", ".join(f"{n} {count}" for n, count in found["plugins"].items()),
        "broken": "; ".join(found["broken"]) or "none",
        "kernels": "; ".join(found["kernels"]),
        "threads": f"{found['threads']} in a run (SPARSEMOR_THREADS), {found['cores']} cores",
        "cache": f"{found['cache']['folder']}: {sum(found['cache']['bytes'].values()) / 1e6:.3g} "
                 f"MB{'' if found['cache']['writable'] else ', NOT WRITABLE'}",
        "compiled": f"{found['cache']['bytes'].get('machine_code', 0) / 1e6:.3g} MB of machine "
                    "code" if found["cache"]["bytes"].get("machine_code") else
                    "no machine code kept" + ("" if not found["extras"].get("fast") else
                                              ", numba is not installed")}
    table = Table.grid(Column(no_wrap=True), Column(overflow="fold"), padding=(0, 2, 0, 0))
    for name, text in rows.items():
        table.add_row(name, Text(text))
    Console(highlight=False).print(table)


def facts() -> dict[str, Any]:
    """Versions, extras, kernels, threads and cache, as plain data."""
    import scipy.linalg  # noqa: F401  loads its BLAS library
    from threadpoolctl import threadpool_info

    from sparsemor.core.linalg.threads import threads
    from sparsemor.core.simulation.cache import Cache

    packages, missing, extras = _dependencies()
    registry = Registry()
    offers = Counter(p.distribution for kind in registry.kinds() for p in registry.names(kind))
    store, sizes = Cache(), Counter[str]()
    for entry in store.contents().entries:
        sizes[entry.kind] += entry.size
    place = store.root
    while not place.exists():
        place = place.parent
    libraries = [f"{lib['internal_api']} {lib['version']}"
                 + (f" for {kernel}" if (kernel := lib.get("architecture")) else "")
                 for lib in threadpool_info() if lib["user_api"] == "blas"]
    return {
        "sparsemor": metadata.version("sparsemor"), "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}", "packages": packages,
        "missing": missing, "extras": extras, "plugins": dict(sorted(offers.items())),
        "broken": list(_broken(registry)), "kernels": list(dict.fromkeys(libraries)),
        "threads": threads(), "cores": os.cpu_count(),
        "cache": {"folder": str(store.root), "bytes": dict(sizes),
                  "writable": os.access(place, os.W_OK)}}


def _dependencies() -> tuple[dict[str, str], list[str], dict[str, list[str]]]:
    """Version of each installed requirement, those that are missing, and extra -> its packages that
    are missing."""
    packages, missing, extras = dict[str, str](), list[str](), dict[str, list[str]]()
    for line in metadata.requires("sparsemor") or ():
        requirement, _, condition = line.partition(";")
        name = _NAME.match(requirement.strip())
        extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", condition)
        if name is None or extra is not None and extra[1] in DEVELOPMENT:
            continue
        try:
            packages[name[0]] = metadata.version(name[0])
            absent = []
        except metadata.PackageNotFoundError:
            absent = [name[0]]
        if extra is None:
            missing += absent
        else:
            extras[extra[1]] = [*extras.get(extra[1], []), *absent]
    return packages, missing, extras


def _broken(registry: Registry) -> Iterator[str]:
    """Plugins of other distributions that cannot be used; `sparsemor plugins KIND` says why."""
    for kind in registry.kinds():
        for plugin in registry.names(kind):
            if plugin.distribution != OWN:
                try:
                    registry.load(kind, registry.spelling(plugin))
                except InputError:
                    yield f"{kind} {plugin.qualified}"
