"""Offline products read through the cache, with the computing time of each, also of cache hits."""

import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from sparsemor.core.arrays import Arrays
from sparsemor.core.model.factorizations import Factored
from sparsemor.core.model.model import Model
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.simulation.cache import SPENT, Cache


@dataclass(slots=True)
class OfflineProduct:
    """Offline product (snapshots, basis, ..) while it is computed or read.

    name: kind and key; place: directory of its cache entry, if any; hit: True if it was in the
    cache; arrays: its content, which whoever computes it sets if it was not; inside: computing
    times of the products that it is computed from, s; nested: wall time spent on them, s.
    """

    name: str
    place: Path | None
    hit: bool = False
    arrays: Arrays = field(default_factory=dict)
    inside: dict[str, float] = field(default_factory=dict)
    nested: float = 0.0


class OfflineCost:
    """Computing times of offline products, s by product, each counted once. The cache entry of a
    product stores also the times of the products that it was computed from.

    waited: wall time that this process spent computing or reading products, s; _costs: product ->
    times of itself and of those that it was computed from; _open: products that are being computed,
    each for the one before it.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.waited = 0.0
        self._costs: dict[str, Mapping[str, float]] = {}
        self._open: list[OfflineProduct] = []

    @property
    def total(self) -> float:
        """Total time of all products in use, s."""
        return sum(self.seconds.values())

    def whole(self, elapsed: float) -> float:
        """Time that an offline stage would take without any cached product, s; elapsed: time it
        took, s."""
        return max(elapsed - self.waited, 0.0) + self.total

    def use(self, names: Iterable[str]) -> None:
        """Counts products as such that the product is computed from that is computed now."""
        if self._open:
            for name in names:
                self._open[-1].inside |= self._costs.get(name, {})

    @contextmanager
    def counted(self, one: OfflineProduct) -> Iterator[None]:
        """Context around computing or reading a product; the caller sets `hit`. A product may be
        computed for another one, the last of `_open`."""
        name, place = one.name, one.place
        self._open.append(one)
        start = time.perf_counter()
        try:
            yield
        finally:
            self._open.pop()
        elapsed = time.perf_counter() - start
        # times of this product and of those that it was computed from
        if one.hit:
            cost = dict(_read(place))
        else:
            cost = one.inside | {name: max(elapsed - one.nested, 0.0)}
            record(place, cost)
        self.seconds |= cost
        self._costs[name] = cost
        if self._open:
            self._open[-1].inside |= cost
            self._open[-1].nested += elapsed
        else:
            self.waited += elapsed


def record(place: Path | None, cost: Mapping[str, float]) -> None:
    """Writes the computing times of a product (s by product) next to its cache entry."""
    if place is not None and place.is_dir():
        try:
            (place / SPENT).write_text(json.dumps(cost), encoding="utf-8")
        except OSError:
            pass  # a full disk costs this number only


def _read(place: Path | None) -> Mapping[str, float]:
    """Computing times, s by product, that `record` wrote next to a cache entry; {} without them."""
    if place is None:
        return {}
    try:
        found = json.loads((place / SPENT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}  # kept by an older version, or being written
    return {str(k): float(v) for k, v in found.items()} if isinstance(found, dict) else {}


class Products:
    """Offline products, computed once and then read from the cache; cache: None stores nothing.

    used: product kind -> "hit", "miss" or "mixed"; seconds: product kind -> wall time of computing
    or reading, s; spent: computing times; factorizations: reports of the linear systems that were
    solved for them.
    """

    def __init__(self, cache: Cache | None) -> None:
        self.cache = cache
        self.used: dict[str, str] = {}
        self.seconds: dict[str, float] = {}
        self.spent = OfflineCost()
        self.factorizations: list[Factored] = []
        self._scratch: TemporaryFolder | None = None

    def scratch(self) -> Path:
        """Scratch directory for arrays that do not fit in memory. Files that are not moved to the
        cache are deleted together with these products."""
        if self._scratch is None:
            self._scratch = TemporaryFolder(None if self.cache is None else self.cache.root)
        return self._scratch.path

    def store(
        self, kind: str, key: str, arrays: Arrays, seconds: float
    ) -> None:
        """Stores arrays that a run has computed in the cache; seconds: their computing time, s."""
        if self.cache is None:
            return
        _, hit = self.cache.get_or_make(kind, key, lambda: arrays)
        if not hit:
            record(self.cache.place(kind, key), {f"{kind}/{key}": seconds})

    @contextmanager
    def in_other_processes(self, kind: str) -> Iterator[None]:
        """Context in which other processes compute products of a kind, which store their own
        computing times."""
        start = time.perf_counter()
        yield
        elapsed = time.perf_counter() - start
        self.spent.waited += elapsed
        self.seconds[kind] = self.seconds.get(kind, 0.0) + elapsed

    @contextmanager
    def product(self, kind: str, key: str) -> Iterator[OfflineProduct]:
        """Context around one product. It has its arrays if the cache does (`hit`); else they are
        computed and set inside, and stored at the end:

            with products.product(kind, key) as product:
                if not product.hit:
                    product.arrays = ...
            product.arrays

        Notes in `used` whether all products of its kind were in the cache, and in `seconds` the
        time, s.
        """
        start, cache = time.perf_counter(), self.cache
        one = OfflineProduct(f"{kind}/{key}", None if cache is None else cache.place(kind, key))
        with nullcontext() if cache is None else self.spent.counted(one):
            found = None if cache is None else cache.find(kind, key)
            one.hit, one.arrays = found is not None, found or {}
            yield one
            if cache is not None and not one.hit:
                one.arrays = cache.keep(kind, key, one.arrays)
        label = "hit" if one.hit else "miss"
        self.used[kind] = label if self.used.get(kind, label) == label else "mixed"
        self.seconds[kind] = self.seconds.get(kind, 0.0) + time.perf_counter() - start

    def remember(
        self, kind: str, key: str, make: Callable[[], Arrays]
    ) -> Arrays:
        """Arrays of one product: read from the cache, or computed by `make` and stored."""
        with self.product(kind, key) as product:
            if not product.hit:
                product.arrays = make()
        return product.arrays


def mesh_content(model: Model) -> list[object]:
    """Points, cells and sets of every mesh of a model, for cache keys."""
    return [[m.points, m.nodes, dict(m.point_sets), dict(m.facet_sets), dict(m.cell_sets)]
            for body in model.bodies.values() if (m := body.mesh) is not None]
