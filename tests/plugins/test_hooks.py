"""Observers are told what they ask for; mistakes are refused before the run."""

import pytest

from sparsemor.core.errors import InputError
from sparsemor.core.registry.hooks import RunStart, hookimpl, new_manager
from sparsemor.core.status import Status


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

    from sparsemor.plugins.observers.progress import ProgressBar

    text = io.StringIO()
    console = Console(file=text, force_terminal=True, width=120)
    bar = ProgressBar().observer(console)
    hook = new_manager([bar]).hook
    hook.on_start(run=RunStart("swing", "sparse", 0.0, 0.5, 4, "training"))
    for step in range(1, 5):
        hook.on_step(step=step, t=0.125 * step, x=None, outcome=None)
    hook.on_finish(summary={})
    assert "swing sparse (training)" in text.getvalue()
    assert "t = 0.5 of 0.5 s" in text.getvalue()
    bar.close()
