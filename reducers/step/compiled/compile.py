"""Compilation of the kernel by numba, an optional package (`pip install 'sparsemor[fast]'`).

The functions of kernel.py, mechanics.py, prescribed.py and dense.py are plain Python; numba
compiles copies of them, which call each other's compiled forms. Machine code is kept in the user's
cache folder, under a digest of the sources, so that it is never older than these.
"""

import hashlib
import inspect
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType
from typing import Any

from sparsemor.reducers.step import acceptance
from sparsemor.reducers.step.compiled import dense, kernel, mechanics, prescribed

FUNCTIONS: tuple[Callable[..., object], ...] = (
    acceptance.estimated_error, acceptance.reference, dense.add_product, dense.add_rates,
    dense.add_products, dense.add_turned, dense.product, dense.solve_in_place, dense.norm,
    mechanics.begin, mechanics.functionals, mechanics.combine, mechanics.frames, mechanics.pose,
    mechanics.add_reduced, mechanics.magnitude, mechanics.displaced, mechanics.solve_mechanics,
    prescribed.thermal_forces, prescribed.corrected, prescribed.solve_body,
    prescribed.solve_prescribed, kernel.free_first, kernel.free_motion, kernel.at_departure,
    kernel.predict, kernel.update, kernel.new_first, kernel.new_state, kernel.accept, kernel.heated,
    kernel.heat_ahead, kernel.advance)
"""Functions of the kernel, each after those that it calls."""
CREATE_ARRAYS = ("product", "thermal_forces", "corrected", "solve_body", "solve_prescribed",
                 "heat_ahead", "advance")
"""Names of the functions that create arrays, or take them out of a list. The others, and those of
frames, are compiled without the counts of references to arrays, which took a third of a step."""
REORDERED = ("add_turned",)
"""Names of the functions whose sums may be reordered, which makes them several times faster."""


def installed() -> bool:
    """True if numba can be imported."""
    return find_spec("numba") is not None


def bound(
    frame: Callable[..., object] | None, calls: Sequence[Callable[..., object]],
    compiled: Callable[[FunctionType], Any]
) -> Any:
    """`kernel.advance` with the function of the frames (None: all are prescribed) and `compiled`
    applied to all functions."""
    made: dict[str, Any] = {}
    own = (*calls, mechanics.evaluate_frame if frame is None else frame)
    for function in (*own, *FUNCTIONS):
        assert isinstance(function, FunctionType)
        names = {**function.__globals__, **made}
        copy = FunctionType(function.__code__, names, function.__name__, function.__defaults__)
        made[function.__name__] = compiled(copy)
        if function is frame:
            made["evaluate_frame"] = made[function.__name__]
    return made["advance"]


@cache
def compiled_advance(
    frame: Callable[..., object] | None, calls: tuple[Callable[..., object], ...], folder: Path
) -> Any:
    """Compiled `kernel.advance` for frames with this function; machine code is kept in
    `folder`."""
    import numba  # optional, and takes half a second to import

    config: Any = numba.config
    njit: Any = numba.njit  # its types lack `_nrt`
    before, config.CACHE_DIR = config.CACHE_DIR, str(folder)
    try:
        return bound(frame, calls, lambda f: njit(
            cache=True, error_model="numpy", _nrt=f.__name__ in CREATE_ARRAYS,
            fastmath={"contract", "reassoc"} if f.__name__ in REORDERED else {"contract"})(f))
    finally:
        config.CACHE_DIR = before


@cache
def folder_of(
    root: Path, frame: Callable[..., object] | None, calls: tuple[Callable[..., object], ...]
) -> Path:
    """Folder in `root` of the machine code of these functions and the kernel, named by a digest of
    their sources."""
    files = sorted({__file__, *(
        inspect.getfile(f) for f in (*calls, frame, *FUNCTIONS) if f is not None)})
    return root / hashlib.sha256(b"".join(Path(f).read_bytes() for f in files)).hexdigest()[:16]
