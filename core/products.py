"""Offline products through the cache, with what each cost."""

import shutil
import time
import weakref
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from sparsemor.core.block_solvers import Factored
from sparsemor.core.cache import Cache, scratch_folder
from sparsemor.core.spent import Spent, record


class Products:
    """Arrays that are made once. `used`: product -> "hit" or "miss" of the cache; seconds: how long
    asking for it took here. cache: None keeps nothing. told: the linear systems that were made
    ready on the way."""

    def __init__(self, cache: Cache | None) -> None:
        self.cache = cache
        self.used: dict[str, str] = {}
        self.seconds: dict[str, float] = {}
        self.spent = Spent()
        self.told: list[Factored] = []
        self._scratch: Path | None = None

    def scratch(self) -> Path:
        """A folder for what does not fit in memory. What is in it and is not kept in the cache goes
        with these products."""
        if self._scratch is None:
            self._scratch = scratch_folder(None if self.cache is None else self.cache.root)
            weakref.finalize(self, shutil.rmtree, self._scratch, ignore_errors=True)
        return self._scratch

    def keep(
        self, kind: str, key: str, arrays: Mapping[str, Any], seconds: float
    ) -> None:
        """Put arrays that a run has made into the cache; seconds: what they cost."""
        if self.cache is None:
            return
        _, hit = self.cache.get_or_make(kind, key, lambda: arrays)
        if not hit:
            record(self.cache.place(kind, key), {f"{kind}/{key}": seconds})

    def remember(
        self, kind: str, key: str, make: Callable[[], Mapping[str, Any]]
    ) -> Mapping[str, Any]:
        """Arrays of one product: from the cache, or made and kept there."""
        start = time.perf_counter()
        if self.cache is None:
            arrays, hit = make(), False
        else:
            with self.spent.product(f"{kind}/{key}", self.cache.place(kind, key)) as product:
                arrays, hit = self.cache.get_or_make(kind, key, make)
                product.hit = hit
        label = "hit" if hit else "miss"
        self.used[kind] = label if self.used.get(kind, label) == label else "mixed"
        self.seconds[kind] = self.seconds.get(kind, 0.0) + time.perf_counter() - start
        return arrays
