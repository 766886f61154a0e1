"""CPU limit of the default tier: an unmarked test that takes longer fails, and tells its marker.

Counted are user and system time of the process and of its children, for function-scoped fixtures
and the call. Fixtures of a wider scope are not judged: which test pays for them depends on the
order. A test above the limit is run once more before it fails, and the shorter time counts: the
first time holds the import of libraries, what later tests find in a cache, and the noise of other
programs. The limit is that of a machine that does a fixed piece of work, timed there and then, in
`REFERENCE` seconds: one of half the speed has twice the limit.
"""

import resource
import time
from collections.abc import Generator
from typing import Any

import numpy as np
import pytest
from _pytest.runner import runtestprotocol

TIERS = ("full", "slow", "end_to_end")
REFERENCE = 0.02
"""CPU seconds of `fixed_work` on the machine that the limit is stated for."""


def used() -> float:
    """CPU seconds of this process and of its children that have ended."""
    return sum(spent.ru_utime + spent.ru_stime for spent in (
        resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)))


def fixed_work() -> float:
    """CPU seconds of a fixed mixture of interpreter and small dense solves."""
    start = time.process_time()
    n = np.arange(30.0)
    A, x, kept = 3.0 * np.eye(30) + 1.0 / (1.0 + n[:, None] + n), np.ones(30), {}
    for i in range(2500):
        x = np.linalg.solve(A, x) + 1e-3
        kept[i % 97] = sum(float(v) for v in x[:10].tolist())
    return time.process_time() - start


class CpuLimit:
    """Plugin of one pytest process: CPU seconds since the present test's set-up began."""

    def __init__(self, limit: float) -> None:
        self.limit, self.start, self.shared = limit, 0.0, 0.0
        self.again = self.over = False
        """Whether the present test runs for the second time; whether it took too long."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> bool:
        """One pass through set-up, call and teardown, and a second one after an excess."""
        hook, which = item.ihook, {"nodeid": item.nodeid, "location": item.location}
        hook.pytest_runtest_logstart(**which)
        self.again = self.over = False
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        if self.over:
            self.again = True
            reports = runtestprotocol(item, log=False, nextitem=nextitem)
        for report in reports:
            hook.pytest_runtest_logreport(report=report)
        hook.pytest_runtest_logfinish(**which)
        return True

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_setup(self) -> Generator[None, Any, Any]:
        self.start, self.shared = used(), 0.0
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef[Any],
    ) -> Generator[None, Any, Any]:
        start = used()
        try:
            return (yield)
        finally:
            if fixturedef.scope != "function":
                self.shared += used() - start

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, Any, Any]:
        result = yield
        spent = used() - self.start - self.shared
        if spent > self.limit and not any(item.get_closest_marker(tier) for tier in TIERS):
            limit = self.limit * max(1.0, fixed_work() / REFERENCE)
            self.over = spent > limit
            if self.over and self.again:
                pytest.fail(
                    f"{spent:.2f} CPU-s, where an unmarked test may take {limit:.2f} on this "
                    "machine: shorten it, or mark it @pytest.mark.full (every merge) or "
                    "@pytest.mark.slow (minutes); docs/decisions/0017-tiers-of-tests.md",
                    pytrace=False)
        return result
