"""Steps in which a contact travels far: the run says how few of them a point lies under it."""

from pathlib import Path

import pytest

from sparsemor import load, simulate

SLIDER = Path(__file__).parents[2] / "scenes" / "small_slider.yaml"


@pytest.mark.full
@pytest.mark.parametrize("step, few", [(2.0e-5, False), (3.0e-4, True)])
def test_a_step_too_long_for_the_contact_is_warned_of(step: float, few: bool) -> None:
    """1 m/s over 1.25 mm of sole: 62 steps of 20 us, 4.2 of 300."""
    run = simulate(load(SLIDER, {
        "time.step": step, "time.end": 6.0e-4, "training": {}, "reducer": "full"}))
    (note,) = [n for n in run.summary["notes"] if "lies under" in n] or [""]
    assert bool(note) == few, note
    if few:
        assert "for 4.2 steps only" in note and "2 times as small" in note
