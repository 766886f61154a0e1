"""Continuation of a stored run: to the end that it was planned for, or to a later `time.end`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sparsemor.core.results.metadata import RunHeader
from sparsemor.core.results.npz_archive import write_archive
from sparsemor.core.results.result_variables import STAGE_TIME, fixed_arrays
from sparsemor.core.results.stored_arrays import FIXED, StoredArrays
from sparsemor.core.scene.option_tree import changes
from sparsemor.core.scene.scene import Scene
from sparsemor.core.status import Status

FREE = {"reducer.error_estimate.tolerance", "reducer.error_estimate.action"}
"""Keys of a scene that may change before a stopped run goes on: the steps so far are the same."""
END = {"time.end", "training.end"}
ELSEWHERE = "run into a new directory"


def refusal(attributes: Mapping[str, Any], scene: Scene) -> str:
    """Reason why a run of this scene cannot continue a stored one, "" if it can. attributes: those
    of the stored result."""
    kept, ended = attributes["scene"], attributes["status"] == Status.DONE.value
    # dotted keys, but for those (FREE) on which the steps so far do not depend
    changed = set(changes(kept, scene.dump())) - FREE
    if ended and not changed:
        return "the run has ended; nothing is left to do until a later time.end"
    if attributes.get("enriched"):
        return ("atoms were added during the run, which are those of its steps so far; start "
                "again, with --force or into another directory")
    if not changed:
        return ""
    if not changed <= END:  # keys of a later end of the run
        return f"it was made from another scene; {ELSEWHERE}"
    before = float(kept["time"]["end"])
    if changed == {"training.end"}:
        return f"its training.end is another one; {ELSEWHERE}"
    if scene.time.end <= before:
        return (f"it was made with time.end {before}, and a run is continued to a later one (got "
                f"{scene.time.end}); {ELSEWHERE}")
    if scene.time.control is not None:
        return ("the error that time.control allows in a step depends on time.end, so its steps "
                f"are not those of a longer run; {ELSEWHERE}")
    if attributes.get("fall_back"):
        return f"it left its reduced model before its end; {ELSEWHERE}"
    if attributes.get("estimates") and scene.rigid_stage is not None:
        return ("the error estimate takes its loads from the whole rigid-body pre-simulation, "
                f"which ends with the run; {ELSEWHERE}")
    trained = kept["training"]["end"]  # None: at the end of the run
    trained = before if trained is None else float(trained)
    if scene.training_end != trained and not scene.reducer.full_order:
        return (f"its model was trained to {trained} s, and with a later time.end the training "
                f"ends later, too: add --set training.end={trained} to keep the model, or "
                f"{ELSEWHERE}")
    return ""


def extended(path: Path, document: dict[str, Any], header: RunHeader) -> str:
    """Gives a store the scene of a run to a later end, with the further times of its rigid-body
    pre-simulation; `document`, its header, is changed and not written. Returns the reason why the
    stored steps are not those of the longer run, "" if they are."""
    stored, arrays = StoredArrays(path), document["arrays"]
    found = {name: values for name, (_, values) in fixed_arrays(header).items()}
    for name, values in found.items():
        if name not in arrays or not _begins_with(values, stored.read(name), arrays[name]):
            return (f"with the later end {name} is another one: the reduced model or its loads "
                    f"depend on time.end; {ELSEWHERE}")
    if any(len(values) > arrays[name]["shape"][0] for name, values in found.items()):
        write_archive(path / FIXED, found, document["attributes"]["run"])
    for name, values in found.items():
        arrays[name]["shape"][0] = len(values)
    attributes = header.attributes()
    document["attributes"].update(
        {key: attributes[key] for key in ("scene", "scene_digest", "steps_planned")})
    return ""


def _begins_with(values: Any, kept: Any, entry: Mapping[str, Any]) -> bool:
    """True if an array equals the stored one, or continues it over the times of a
    pre-simulation."""
    longer = entry["dimensions"][0] == STAGE_TIME and len(values) > len(kept)
    return np.array_equal(values[:len(kept)] if longer else values, kept)

