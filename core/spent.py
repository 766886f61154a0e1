"""What offline products cost when they were made, also where a run found them in the cache."""

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

_FILE = "spent.json"


@dataclass(slots=True)
class Product:
    """One product while it is asked for. name: kind and key; place: its cache entry, if any."""

    name: str
    place: Path | None
    hit: bool = False
    inside: dict[str, float] = field(default_factory=dict)
    nested: float = 0.0


class Spent:
    """Seconds by product, each counted once; a product's entry knows those it was made from.

    waited: s that asking for them took here.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.waited = 0.0
        self._open: list[Product] = []

    @property
    def total(self) -> float:
        """What all products in use took to make, s."""
        return sum(self.seconds.values())

    def whole(self, elapsed: float) -> float:
        """An offline stage that took `elapsed` s, had nothing been in the cache, s."""
        return max(elapsed - self.waited, 0.0) + self.total

    @contextmanager
    def product(self, name: str, place: Path | None) -> Iterator[Product]:
        """Around the asking for a product; the caller sets `hit`."""
        one = Product(name, place)
        self._open.append(one)
        start = time.perf_counter()
        try:
            yield one
        finally:
            self._open.pop()
        elapsed = time.perf_counter() - start
        if one.hit:
            cost = dict(_read(place))
        else:
            cost = one.inside | {name: max(elapsed - one.nested, 0.0)}
            record(place, cost)
        self.seconds |= cost
        if self._open:
            self._open[-1].inside |= cost
            self._open[-1].nested += elapsed
        else:
            self.waited += elapsed


def record(place: Path | None, cost: Mapping[str, float]) -> None:
    """Write the cost of a product beside its cache entry, s by product."""
    if place is not None and place.is_dir():
        try:
            (place / _FILE).write_text(json.dumps(cost), encoding="utf-8")
        except OSError:
            pass  # a full disk costs this number only


def _read(place: Path | None) -> Mapping[str, float]:
    if place is None:
        return {}
    try:
        found = json.loads((place / _FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}  # kept by an older version, or being written
    return {str(k): float(v) for k, v in found.items()} if isinstance(found, dict) else {}
