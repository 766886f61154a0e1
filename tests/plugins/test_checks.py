"""Checks of runs are plugins: what a hook returns is told and stored, a failure is one line."""

from pathlib import Path
from typing import Any

import pytest

from small_scenes import SCENES
from sparsemor import Scene, load, simulate
from sparsemor.core.errors import InputError, PluginError
from sparsemor.core.simulation.checks import Checks
from sparsemor.core.status import SolveFailed, Status
from tiers import full

HEAD = """
from sparsemor.core import Check, Findings, Note, SolveFailed, Status

class Own(Check):
    'A check of somebody else.'
"""


def tiny() -> Scene:
    """Loaded anew, with the plugins that are installed now."""
    return load(SCENES / "tiny.yaml")


def offered(distribute: Any, body: str) -> None:
    distribute("odd-pkg", {"check": {"odd": "odd_check:Own"}}, odd_check=HEAD + body)


@pytest.mark.full
def test_notes_and_numbers_of_a_check_are_in_the_summary(distribute: Any) -> None:
    offered(distribute, """
    def on_model(self, scene, model): return [Note("before the solver", "early")]
    def before_steps(self, run): return Findings([Note(f"{run.steps} steps", "count")])
    def after_run(self, run, result): return Findings([Note("done", "late")], {"odd": 7})
""")
    summary = simulate(tiny()).summary
    assert summary["odd"] == 7
    assert [k for k in summary["note_kinds"] if k in ("early", "count", "late")] == [
        "early", "count", "late"]


@pytest.mark.full
def test_a_check_ends_a_run_at_a_step(distribute: Any) -> None:
    offered(distribute, """
    def on_start(self, run, state, whole): return self._look
    def _look(self, done, before, state, active):
        return SolveFailed(Status.OUTSIDE_THEORY, state.t, "", "enough") if done == 3 else None
""")
    with pytest.raises(SolveFailed, match="enough") as caught:
        simulate(tiny())
    result: Any = caught.value.result
    assert caught.value.status is Status.OUTSIDE_THEORY and result.summary["steps"] == 3


@pytest.mark.full
@pytest.mark.parametrize(("body", "said"), [
    ("    def before_steps(self, run): return 1 / 0", "raised ZeroDivisionError: division by zero"),
    ("    def before_steps(self, run): return ['no note']", "returned ('no note')"),
    ("    def on_model(self, scene, model): return None", "returned None"),
    ("    def on_start(self, run, state, whole): return 3", "returned 3")])
def test_a_check_that_fails_before_the_steps_is_one_located_line(
    distribute: Any, body: str, said: str
) -> None:
    offered(distribute, body)
    with pytest.raises(PluginError) as caught:
        simulate(tiny())
    text = str(caught.value)
    assert text.startswith("check odd of odd-pkg 1.0: Own.") and said in text
    assert "odd_check.py:" in text and "\n" not in text


@pytest.mark.full
@pytest.mark.parametrize(("body", "said"), [
    ("    def after_run(self, run, result): return {}['a']", "Own.after_run raised KeyError: 'a'"),
    full("    def after_run(self, run, result): return []", "Own.after_run returned"),
    ("    def after_run(self, run, result): return Findings([], {'odd': float('nan')})",
     "not finite"),
    full("    def on_start(self, run, state, whole): return self._look\n"
         "    def _look(self, *given): raise IndexError('in a step')", "IndexError: in a step")])
def test_a_check_that_fails_later_leaves_the_results(
    distribute: Any, tmp_path: Path, body: str, said: str
) -> None:
    offered(distribute, body)
    with pytest.raises(SolveFailed, match="odd-pkg 1.0") as caught:
        simulate(tiny(), out=tmp_path / "run")
    result: Any = caught.value.result
    assert caught.value.status is Status.PLUGIN_FAILED and said in str(caught.value)
    assert result.summary["status"] == "plugin_failed" and len(result.times) > 0


def test_another_class_is_refused(distribute: Any) -> None:
    distribute("odd-pkg", {"check": {"odd": "odd_check:Other"}}, odd_check=(
        "from sparsemor.core import Plugin\nclass Other(Plugin):\n    'Nothing.'\n"))
    with pytest.raises(InputError, match="odd_check:Other is no sparsemor.core.Check"):
        Checks.for_scene(tiny())
