"""Bases that a packaged scene cannot run on are refused before the first step, and its own and
other right ones are not."""

from typing import Any

import numpy as np
import pytest

from sparsemor.core.errors import InputError
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.prepare import prepared_run

SHORT: dict[str, dict[str, Any]] = {
    "double_pendulum": {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
                        "time.end": 0.3, "training.end": 0.3},
    "slider_plate": {"time.end": 3e-4, "training.end": 3e-4},
    "brake_disk": {"bodies.disk.mesh.refine": 0.4, "bodies.pad.mesh.refine": 0.6,
                   "time.end": 0.1, "training.end": 0.1},
}
WRONG = {
    "double_pendulum": ["modal", "static", "craig_bampton"],
    "slider_plate": ["modal", "static", "attachment"],
    "brake_disk": ["modal", "static", "attachment"],
}
"""Swaps of `reducer.basis` whose runs were `done` with a field wrong by 0.9 to 87 times its largest
change."""
RIGHT: dict[str, list[Any]] = {
    "double_pendulum": [{"use": "dictionary", "bases": ["modal", "pod"]}, "pod"],
    "slider_plate": [{"use": "dictionary", "bases": ["attachment", "pod"]}, "pod"],
    "brake_disk": ["pod"],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SHORT)
@np.errstate(all="ignore")
def test_wrong_bases_are_refused_and_right_ones_are_not(
    name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    cache = Cache(tmp_path_factory.mktemp("cache"))

    def prepare(**changes: Any) -> None:
        scene = load(name, {**SHORT[name], "check_stability": "off", **changes,
                            "check_trial_space": "refuse"})
        prepared_run(scene, cache, new_manager([]))

    prepare()
    for basis in RIGHT[name]:
        prepare(**{"reducer.basis": basis})
    for basis in WRONG[name]:
        with pytest.raises(InputError, match="atoms of .* cannot represent") as refused:
            prepare(**{"reducer.basis": basis})
        assert {f.key for f in refused.value.faults} == {"check_trial_space"}, basis
