"""The tiers of tests: an unmarked test that takes long fails, and few long ones stay unmarked."""

from pathlib import Path

import pytest

pytest_plugins = ["pytester"]
TESTS = Path(__file__).parents[2]
KEEPERS = 15
WRITTEN = """
import time
import pytest

def burn(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass

@pytest.fixture(scope="module")
def shared():
    burn(0.06)

@pytest.fixture
def own():
    burn(0.06)

def test_short(shared): pass
def test_long(): burn(0.06)
def test_long_the_first_time(known=[]):
    burn(0.0 if known else 0.06)
    known.append(1)
def test_long_before_it_starts(own): pass
@pytest.mark.full
def test_marked(): burn(0.06)
@pytest.mark.end_to_end
def test_kept(): burn(0.06)
"""


@pytest.fixture
def written(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makepyfile(WRITTEN)
    pytester.makeconftest("""
        import pytest
        from cpu_limit import CpuLimit

        def pytest_configure(config):
            config.pluginmanager.register(CpuLimit(0.03))
        """)
    pytester.makeini("[pytest]\nmarkers =\n  full:\n  end_to_end:\n")
    return pytester


@pytest.mark.full
def test_an_unmarked_test_of_long_is_refused(
    written: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a machine that is as fast as the one of the limit, which this one may not be."""
    monkeypatch.setattr("cpu_limit.fixed_work", lambda: 0.0)
    run = written.runpytest_inprocess()
    run.assert_outcomes(passed=4, failed=2)
    run.stdout.fnmatch_lines([
        "*test_long*", "0.* CPU-s, where an unmarked test may take 0.0*@pytest.mark.full*",
        "*test_long_before_it_starts*"])


@pytest.mark.full
def test_a_slower_machine_has_a_higher_limit(
    written: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cpu_limit.fixed_work", lambda: 10.0)
    written.runpytest_inprocess().assert_outcomes(passed=6)


def test_few_long_tests_stay_in_the_default_tier() -> None:
    kept = [line for path in TESTS.rglob("test_*.py") if path != Path(__file__)
            for line in path.read_text(encoding="utf-8").splitlines()
            if "mark.end_to_end" in line]
    assert 0 < len(kept) <= KEEPERS, kept
