"""Law kit of an observer (receives the events of a run, such as a progress bar)."""

from collections.abc import Callable

import numpy as np

from sparsemor.core.protocols.integrator import StepOutcome
from sparsemor.core.protocols.layout import Block, Layout
from sparsemor.core.registry.hooks import RunStart, new_manager
from sparsemor.core.status import Status
from sparsemor.core.testing.random_inputs import TEMPERATURES, law


def check_observer(make: Callable[[], object], seed: int = 0) -> None:
    """Laws of an observer: it listens to known events only, accepts them in every order in which a
    run can send them, with a failure and without, twice in a row (training run and run), and
    changes none of their arrays.

    make: returns a new observer, such as `plugin.observer`.
    """
    rng = np.random.default_rng(seed)
    layout = Layout([Block("body", TEMPERATURES, 5)])
    (name,) = (b.name for b in layout)
    for fails in (False, True):
        observer = make()
        hook = new_manager([observer]).hook
        for phase in ("training", "run"):
            hook.on_offline(product="basis")
            hook.on_start(run=RunStart("scene", "reducer", 0.0, 1.0, 3, phase))
            hook.on_resample(block=name, rows=np.array([0, 3]))
            for step in range(1, 3):
                x = rng.standard_normal(layout.size)
                before = x.copy()
                hook.on_step(step=step, t=0.1 * step, x=x,
                             outcome=StepOutcome(x, Status.DONE, 1))
                law(np.array_equal(x, before), "the observer wrote to the state")
                support = np.ones(5, dtype=np.bool_)
                hook.on_support_change(t=0.1 * step, block=name, support=support)
                law(bool(support.all()), "the observer wrote to the support")
            if fails:
                hook.on_failure(status=Status.DIVERGED, t=0.3, block=name, detail="")
            hook.on_finish(summary={"phase": phase, "steps": 2})
