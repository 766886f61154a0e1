"""Initial state of a run from a stored result: rigid coordinates, displacements and temperatures,
with their rates."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import Fault, InputError
from sparsemor.core.linalg.dense import least_squares_coefficients
from sparsemor.core.model.initial_state import open_joints
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note, information
from sparsemor.core.protocols.basis import Dictionary
from sparsemor.core.results.checkpoint import Checkpoint, load_checkpoint
from sparsemor.core.results.relative_error_estimates import LIMIT
from sparsemor.core.results.run_result import RunResult, open_result
from sparsemor.core.scene.scene import Scene

KEY = "initial.result"


def started_from_result(scene: Scene, model: Model) -> Model:
    """The model with the initial values x0 and rates v0 of the option `initial` of its scene; the
    model itself without that option. Raises InputError for a result of another model."""
    if scene.initial is None:
        return model
    result, step = _opened(scene)
    _check_meshes(result, model)
    x, v, rates = model.x0.copy(), model.v0.copy(), _Rates(result, step)
    faults = []
    for b in model.layout.differential:
        if b.name not in result.layout or result.layout.block(b.name).size != b.size:
            faults.append(Fault(KEY, f"the result has no {b.name} with {b.size} unknowns"))
            continue
        at = model.layout[b.name]
        x[at] = result.block(b.name, np.array([step]))[0]
        if b.kind.order == 2 and rates.moves:  # rates of temperatures follow from the equations
            v[at] = rates.of(b.name)
    if faults:
        raise InputError(faults)
    return replace(model, x0=x, v0=v)


def initial_notes(
    scene: Scene, model: Model, dictionaries: Mapping[str, Dictionary]
) -> tuple[Note, ...]:
    """Notes on the initial state, and on the error of each block whose atoms do not contain it,
    relative to the largest change in the result: a warning from 0.1 on. Raises InputError for a
    state that joints do not fit at 0 s."""
    if scene.initial is None:
        return ()
    result, step = _opened(scene)
    faults = [Fault(KEY, f"the state at {result.times[step]:.6g} s does not fit joint {joint} at "
                    f"0 s, where time starts again: {gap:.3g} (m, rad, or a cosine); take a state "
                    "at which its sides meet and its motion is that at 0 s (of an analysis: `--at "
                    "0`), or shift its motion in time")
              for joint, gap in open_joints(model).items()]
    if faults:
        raise InputError(faults)
    errors = {}
    for name, d in dictionaries.items():
        x = model.x0[model.layout[name]] - d.offset
        left = x - d.atoms @ least_squares_coefficients(d.atoms, x[:, None])[:, 0]
        kept = result.block(name)
        change = float(np.abs(kept - kept[0]).max())
        errors[name] = float(np.abs(left).max()) / (change or 1.0)
    text = (f"starts from the state of {scene.initial.result} at {result.times[step]:.6g} s, with "
            f"{_Rates(result, step).source}")
    if errors:
        text += "; error of its projection onto the atoms, relative to the largest change: "
        text += ", ".join(f"{name} {e:.2g}" for name, e in errors.items())
    poor = max(errors.values(), default=0.0) > LIMIT
    return (Note(text, "initial") if poor else information(text, "initial"),)


class _Rates:
    """Rates of the blocks at a stored step of a result: those of the checkpoint at its last step;
    elsewhere differences to the stored step before, which are the rates of BDF1 if every step is
    stored. step: index among the stored steps; _saved: the checkpoint at this step, or None."""

    def __init__(self, result: RunResult, step: int) -> None:
        self.result, self.step = result, step
        self.moves = step > 0 and "states" not in result.summary
        """False for the first state of a run, and for states of an analysis, which are no motion:
        the rates are those of the scene."""
        found = load_checkpoint(result.path) if step == len(result.times) - 1 else None
        self._saved = found if found is not None and self._belongs(found) else None

    def _belongs(self, found: Checkpoint) -> bool:
        here = float(self.result.times[self.step])
        return (found.run, float(found.arrays["t"])) == (self.result.attributes["run"], here)

    @property
    def source(self) -> str:
        """Origin of the rates, in words."""
        if not self.moves:
            return "the rates of the scene"
        return "its rates" if self._saved is not None else (
            "the mean rates since the stored step before")

    def of(self, name: str) -> FloatArray:
        """(n,) rates of a block's full-order unknowns."""
        result, step = self.result, self.step
        if self._saved is not None:
            v = self._saved.arrays["v"][result.solver_layout[name]]
            return np.asarray(result.atoms(name) @ v if result.reduced(name) else v)
        before, now = result.block(name, np.array([step - 1, step]))
        return np.asarray((now - before) / (result.times[step] - result.times[step - 1]))


def _opened(scene: Scene) -> tuple[RunResult, int]:
    """The result that `initial` names, and the index of the stored step. Raises InputError."""
    assert scene.initial is not None
    try:
        result = open_result(scene.initial.result)
        wanted = scene.initial.time
        last = len(result.times) - 1
        if last < 0:
            raise InputError("the run has no stored step yet")
    except InputError as error:
        raise InputError(str(error), KEY) from None
    try:
        return result, last if wanted is None else int(result.steps_at([wanted])[0])
    except InputError as error:
        raise InputError(str(error), "initial.time") from None


def _check_meshes(result: RunResult, model: Model) -> None:
    """Raises InputError if a body with a mesh has another one in the result."""
    for name, shape in model.shapes().items():
        if name in result.bodies and not np.array_equal(result.points(name), shape.points):
            raise InputError(f"{name} has another mesh in the result", KEY)
