"""Small assembled scenes and derivatives of their equations, for the law kits of bodies, joints,
contacts and loads."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.equations import system_jacobian, system_residual
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import ContactPlugin, JointPlugin, LoadPlugin, Part
from sparsemor.core.scene.scene import Scene
from sparsemor.core.status import SolveFailed
from sparsemor.core.testing.in_memory_run import March, march
from sparsemor.core.testing.random_inputs import law

Entries = Mapping[str, Any]
"""Entries of a scene by name: plugins, or mappings as in a scene file."""
STEP, STEPS = 1e-3, 3


def small_scene(bodies: Entries, **others: Entries) -> Scene:
    """A scene of a few full-order steps of 1 ms. others: `joints`, `contacts`, `loads`."""
    return Scene.model_validate({
        "format": 1, "bodies": dict(bodies), "time": {"end": STEPS * STEP, "step": STEP}, **others})


def derivative(model: Model, rate: int) -> FloatArray:
    """Derivative (n, n) of the residual at the start by x (rate 0), v (1) or a (2)."""
    n, large = model.layout.size, 1e10
    at = (model.x0, model.v0, np.zeros(n), 0.0)
    of = partial(system_jacobian, model.layout, model.terms, *at)
    c = np.zeros((3, n))
    K = np.asarray(of(c[1], c[2]).toarray())
    if rate == 0:
        return K
    c[rate] = large
    return np.asarray(of(c[1], c[2]).toarray() - K) / large


def start_residual(model: Model) -> FloatArray:
    """Residual (n,) at the start, with zero accelerations."""
    zero = np.zeros(model.layout.size)
    return system_residual(model.layout, model.terms, model.x0, model.v0, zero, 0.0)


def runs(scene: Scene) -> March:
    """Short run of a small scene. Raises AssertionError if a step fails or a value is not
    finite."""
    try:
        done = march(scene)
    except SolveFailed as error:
        raise AssertionError(f"a run of {STEPS} steps failed: {error}") from error
    law(np.isfinite(done.x).all(), f"values of a run of {STEPS} steps are not finite")
    return done


def refuses_absent_bodies(plugin: JointPlugin | ContactPlugin | LoadPlugin) -> None:
    """Checks that a joint, contact or load on bodies that the scene does not have raises
    InputError."""
    try:
        plugin.build("part", {})
    except InputError:
        return
    except Exception as error:  # whatever else a plugin's code raises, the law is broken
        raise AssertionError("a scene without the bodies that it names: expected an InputError, "
                             f"got {error!r}") from error


def without_unknowns(part: Part) -> None:
    law(not any(b.size for b in part.blocks()), "a load or contact has no unknowns of its own")
