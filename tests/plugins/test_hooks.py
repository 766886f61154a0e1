"""Observers are told what they ask for; mistakes are refused before the run."""

from pathlib import Path

import pytest

from sparsemor import load, simulate
from sparsemor.core.errors import InputError
from sparsemor.core.registry.hooks import RunStart, hookimpl, new_manager
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.status import Status
from sparsemor.plugins.observers.progress import ProgressBar


class Counter:
    def __init__(self) -> None:
        self.seen: list[object] = []

    @hookimpl
    def on_step(self, t, step):
        self.seen.append((step, t))
        return "ignored"

    @hookimpl
    def on_failure(self, status):
        self.seen.append(status)


def test_an_observer_takes_the_arguments_it_needs():
    counter = Counter()
    manager = new_manager([counter])
    manager.hook.on_step(step=1, t=0.5, x=None, outcome=None)
    manager.hook.on_finish(summary={})
    manager.hook.on_failure(status=Status.SINGULAR, t=0.5, block="", detail="")
    assert counter.seen == [(1, 0.5), Status.SINGULAR]


def test_each_run_has_its_own_manager():
    counter = Counter()
    assert new_manager([counter]).has_observers
    assert not new_manager().has_observers
    new_manager().hook.on_step(step=1, t=0.5, x=None, outcome=None)
    assert counter.seen == []


def test_mistakes_are_refused():
    class Misspelt:
        @hookimpl
        def on_stepp(self, t): ...

    class Wrong:
        @hookimpl
        def on_step(self, time): ...

    class Silent:
        def on_step(self, t): ...

    for observer, reason in [(Misspelt(), "on_stepp"), (Wrong(), "time"),
                             (Silent(), "listens to nothing")]:
        with pytest.raises(InputError, match=reason):
            new_manager([observer])
    twice = Counter()
    with pytest.raises(InputError, match="observers: "):
        new_manager([twice, twice])


def test_the_progress_bar_follows_a_run():
    import io

    from rich.console import Console

    text = io.StringIO()
    console = Console(file=text, force_terminal=True, width=120)
    bar = ProgressBar().observer(console)
    hook = new_manager([bar]).hook
    hook.on_offline(product="error_space")
    hook.on_start(run=RunStart("swing", "sparse", 0.0, 0.5, 4, "training"))
    for step in range(1, 5):
        hook.on_step(step=step, t=0.125 * step, x=None, outcome=None)
    hook.on_finish(summary={})
    assert "offline: error space" in text.getvalue()
    assert "swing sparse (training)" in text.getvalue()
    assert "t = 0.5 of 0.5 s" in text.getvalue()
    bar.close()


class Phases:
    def __init__(self) -> None:
        self.seen: list[str] = []

    @hookimpl
    def on_offline(self, product: str) -> None:
        self.seen.append(product)

    @hookimpl
    def on_start(self, run: RunStart) -> None:
        self.seen.append(run.phase)

    def close(self) -> None:
        self.seen.append("closed")


@pytest.mark.full
def test_what_is_computed_before_the_first_step_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    swing = load(Path(__file__).parents[1] / "scenes" / "swing.yaml", {
        "time.end": 0.02, "training.end": 0.02, "check_stability": "off",
        "reducer": {"use": "ecsw", "constant": "weighted", "basis": {"use": "pod", "count": 3}}})
    told, bar, cache = Phases(), Phases(), Cache(tmp_path)
    monkeypatch.setattr(ProgressBar, "observer", lambda self: bar)
    simulate(swing, cache=cache, observers=[told], progress=True)
    assert bar.seen == [*told.seen, "closed"]
    assert told.seen[:2] == ["training", "basis"] and told.seen[-1] == "run"
    assert "weights" in told.seen
    again = Phases()
    simulate(swing, cache=cache, observers=[again])
    assert again.seen == ["run"]
