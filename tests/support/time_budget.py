"""Time budget of a session: no test is started after so many minutes; those left are skipped.

The order of the files is random and that of the day, so that each has its turn.
"""

import os
import time
from datetime import date
from random import Random

import pytest

DAY = "SPARSEMOR_TEST_DAY"
"""Set by the first process, so that workers that start after midnight order as it does."""


class TimeBudget:
    """Plugin of one pytest process."""

    def __init__(self, minutes: float) -> None:
        self.minutes, self.end = minutes, time.monotonic() + 60.0 * minutes
        self.day = os.environ.setdefault(DAY, str(date.today()))

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        files = list(dict.fromkeys(item.path for item in items))
        Random(self.day).shuffle(files)
        items.sort(key=lambda item: files.index(item.path))

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self) -> None:
        if time.monotonic() > self.end:
            pytest.skip(f"not started within {self.minutes:g} minutes")
