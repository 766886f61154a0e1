"""Wall-clock gain of a reduced model, and the number of runs after which its offline time has paid
off (break-even)."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from sparsemor.core.results.cost import RunFacts
from sparsemor.core.results.tables import number, text_table


class Gain(NamedTuple):
    """Wall-clock time of the reference over that of a run: once, with the preparation (with an
    empty cache); again: of its steps alone, as a further run of a kept model has."""

    once: float
    again: float


def gains(facts: Mapping[str, RunFacts], base: str) -> dict[str, Gain]:
    """Run -> gain over the run `base`, for runs that both reached the same end."""
    full, found = facts[base], {}
    for name, own in facts.items():
        times = (full.offline_seconds, full.online_seconds, own.offline_whole_seconds,
                 own.online_seconds)
        if name == base or None in times or not (full.status.ok and own.status.ok):
            continue
        offline, online, before, steps = (float(t or 0.0) for t in times)
        if steps > 0.0 and abs(full.end - own.end) <= 1e-9 * max(full.end, own.end):
            found[name] = Gain((offline + online) / (before + steps), (offline + online) / steps)
    return found


def gain_table(found: Mapping[str, Gain]) -> str:
    """Text table of gains."""
    return text_table([["wall-clock gain", "with offline", "further runs"], *(
        [name, number(g.once, ".3g"), number(g.again, ".3g")] for name, g in found.items())])


def pays_after(full: RunFacts, own: RunFacts) -> int | None:
    """Break-even number of runs: offline time / (online time of full order - own online time),
    rounded up.

    Number of online runs of the same time span after which the offline time is recovered. The
    offline time is that with an empty cache; otherwise the second run would appear to be free. None
    if the offline time is never recovered, was not recorded, or one of the runs did not reach its
    end.
    """
    offline, online, base = own.offline_whole_seconds, own.online_seconds, full.online_seconds
    if offline is None or online is None or base is None or online >= base:
        return None
    same_span = abs(full.end - own.end) <= 1e-9 * max(full.end, own.end)
    if not (full.status.ok and own.status.ok and same_span):
        return None
    return max(1, math.ceil(offline / (base - online)))
