"""CPU limit of the default tier: an unmarked test that takes longer fails, and tells its marker.

Counted are user and system time of the process and of its children, for function-scoped fixtures
and the call. Fixtures of a wider scope and tests that import a library first are not judged: which
test pays for them depends on the order. An excess is compared with a fixed piece of work, timed
there and then, so that a machine of half the speed has twice the limit.
"""

import resource
import sys
import time
from collections.abc import Generator
from typing import Any

import numpy as np
import pytest

TIERS = ("full", "slow", "end_to_end")
REFERENCE = 0.02
"""CPU seconds of `fixed_work` on the machine that the limit is stated for; where the tests were
measured and marked it took 0.043 s, so that 0.3 s of the limit were 0.65 s there."""
TOLERANCE = 2.0
"""A test fails above this multiple of the limit: times of one test on a shared machine, and of
Hypothesis' examples, spread by 1.6."""
LIBRARY = 20
"""Modules imported during a test from which on it counts as the first user of a library."""


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
        self.limit, self.start, self.shared, self.modules = limit, 0.0, 0.0, 0

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_setup(self) -> Generator[None, Any, Any]:
        self.start, self.shared, self.modules = used(), 0.0, len(sys.modules)
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
        if (spent > self.limit and not any(item.get_closest_marker(tier) for tier in TIERS)
                and len(sys.modules) - self.modules < LIBRARY):
            limit = TOLERANCE * self.limit * max(1.0, fixed_work() / REFERENCE)
            if spent > limit:
                pytest.fail(
                    f"{spent:.2f} CPU-s, where an unmarked test may take {limit:.2f} on this "
                    "machine: shorten it, or mark it @pytest.mark.full (every merge) or "
                    "@pytest.mark.slow (minutes); docs/decisions/0017-tiers-of-tests.md",
                    pytrace=False)
        return result
