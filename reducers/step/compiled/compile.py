"""Compilation of the kernel by numba, an optional package (`pip install 'sparsemor[fast]'`).

The functions of dense.py, kernel.py, local.py, mechanics.py and prescribed.py are plain Python;
numba compiles copies of them, which call each other's compiled forms. Machine code is kept under a
digest of the sources, so that it is never older than these, where only its user can have written it
(`MachineCode`): numba's own files are pickles, found by an index that is a pickle.
"""

import hashlib
import inspect
import logging
import pickle
import platform
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple, TypeAlias

from sparsemor.core.protocols.poses import steered, tangent
from sparsemor.reducers.step import acceptance
from sparsemor.reducers.step.compiled import dense, kernel, local, mechanics, prescribed
from sparsemor.reducers.step.compiled.machine_code import MachineCode

_log = logging.getLogger(__name__)
FUNCTIONS: tuple[Callable[..., object], ...] = (
    steered, tangent, acceptance.estimated_error, acceptance.reference, dense.add_product,
    dense.add_rates,
    dense.add_products, dense.product, dense.solve_in_place, dense.norm,
    local.evaluate_law, local.variables, local.bends, local.evaluate_points, local.rows_at,
    local.rows_of,
    local.local_rows, local.factor_in_place, local.solve_factored, mechanics.begin,
    mechanics.begin_local, mechanics.add_local, mechanics.functionals, mechanics.combine,
    mechanics.frames, mechanics.pose, mechanics.add_reduced, mechanics.magnitude,
    mechanics.displaced, mechanics.solve_mechanics, prescribed.thermal_forces, prescribed.corrected,
    prescribed.solve_body, prescribed.solve_prescribed, kernel.free_first, kernel.free_motion,
    kernel.at_departure, kernel.predict, kernel.update, kernel.new_first, kernel.new_state,
    kernel.accept, kernel.renewed, kernel.iterate_heat, kernel.heated, kernel.heat_ahead,
    kernel.advance)
"""Functions of the kernel, each after those that it calls."""
BARE: tuple[Callable[..., object], ...] = (
    steered, tangent, acceptance.estimated_error, acceptance.reference, dense.add_product,
    dense.add_rates,
    dense.add_products, dense.solve_in_place, dense.norm, mechanics.begin,
    mechanics.functionals, mechanics.combine, mechanics.frames, mechanics.pose,
    mechanics.add_reduced, mechanics.magnitude, mechanics.displaced, kernel.free_first,
    kernel.free_motion, kernel.at_departure, kernel.predict, kernel.update, kernel.new_first,
    kernel.new_state, kernel.accept)
"""Functions that create no array and take none out of a list. They, and those of frames, are
compiled without the counts of references to arrays, which took a third of a step."""


def installed() -> bool:
    """True if numba can be imported."""
    return find_spec("numba") is not None


Called: TypeAlias = tuple[Callable[..., object], tuple[Callable[..., object], ...]]
"""A function on arrays, and those that it calls, each after those that it calls itself."""


class Functions(NamedTuple):
    """Functions that belong to a model: that of its frames, None where the motion of all is
    prescribed, and those of the laws of its local terms."""

    frame: Called | None
    laws: tuple[Called, ...]

    @property
    def all(self) -> list[Callable[..., object]]:
        own = [self.frame] if self.frame is not None else []
        return [f for function, calls in (*own, *self.laws) for f in (*calls, function)]


def bound(functions: Functions, compiled: Callable[[FunctionType], Any]) -> Any:
    """`kernel.advance` with these functions and `compiled` applied to all."""
    made: dict[str, Any] = {}

    def with_calls(of: Called) -> Any:
        names: dict[str, Any] = {}
        for function in (*of[1], of[0]):
            names[function.__name__] = copied(function, names)
        return names[of[0].__name__]

    def copied(function: Callable[..., object], names: dict[str, Any]) -> Any:
        assert isinstance(function, FunctionType)
        return compiled(FunctionType(function.__code__, {**function.__globals__, **names},
                                     function.__name__, function.__defaults__))

    made["evaluate_frame"] = with_calls(functions.frame or (mechanics.evaluate_frame, ()))
    none = with_calls((local.no_law, ()))
    for i in range(local.LAWS):
        made[f"law_{i}"] = with_calls(functions.laws[i]) if i < len(functions.laws) else none
    for function in FUNCTIONS:
        made[function.__name__] = copied(function, made)
    return made["advance"]


@cache
def compiled_advance(functions: Functions) -> Any:
    """Compiled `kernel.advance` for models with these functions."""
    import numba  # optional, and takes half a second to import

    njit: Any = numba.njit  # its types lack `_nrt`
    kept = MachineCode(name_of(functions))
    if not kept:
        _log.warning("compiling the time step once, about a minute; machine code: %s",
                     kept.folder or "not kept, since no folder is this user's alone")
    frame = () if functions.frame is None else (functions.frame[0], *functions.frame[1])
    bare = {f.__code__ for f in (*BARE, mechanics.evaluate_frame, *frame)
            if isinstance(f, FunctionType)}
    # sums may be reordered where that makes them several times faster
    fast, reordered = {"contract"}, {"contract", "reassoc"}
    return bound(functions, lambda f: with_kept_code(njit(
        error_model="numpy", _nrt=f.__code__ not in bare,
        fastmath=reordered if f.__name__ == "solve_factored" else fast)(f), kept))


def with_kept_code(compiled: Any, kept: MachineCode) -> Any:
    """The compiled function, with its machine code taken from `kept` where that has it."""
    caching, serialize, compiler = (import_module(f"numba.core.{m}") for m in (
        "caching", "serialize", "compiler"))  # optional

    class Cache(caching._Cache):  # type: ignore[misc, name-defined]
        """Cache of one function for numba."""

        cache_path = str(kept.folder)

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            target_context.refresh()
            found = kept.read(self._key(sig, target_context.codegen()))
            return None if found is None else compiler.CompileResult._rebuild(
                target_context, *pickle.loads(found))

        def save_overload(self, sig: Any, data: Any) -> None:
            kept.write(self._key(sig, data.codegen), serialize.dumps(data._reduce()))

        def _key(self, sig: Any, codegen: Any) -> str:
            function = compiled.py_func
            return repr((sig, codegen.magic_tuple(), function.__module__, function.__qualname__,
                         hashlib.sha256(function.__code__.co_code).hexdigest()))

        def enable(self) -> None: ...
        def disable(self) -> None: ...
        def flush(self) -> None: ...

    compiled._cache = Cache()
    return compiled


@cache
def name_of(functions: Functions) -> str:
    """Name of the machine code of the kernel with these functions: a digest of their sources and
    their order, and of the versions of Python and numba."""
    own = functions.all
    files = sorted({__file__, *(inspect.getfile(f) for f in (*own, *FUNCTIONS))})
    frame = () if functions.frame is None else (functions.frame,)
    names = repr([[f"{f.__module__}.{f.__qualname__}" for f in (function, *calls)]
                  for function, calls in (*frame, *functions.laws)])
    versions = [platform.python_version(), *map(version, ("numba", "llvmlite", "numpy"))]
    sources = b"".join(Path(f).read_bytes() for f in files)
    return hashlib.sha256(sources + names.encode() + repr(versions).encode()).hexdigest()[:16]
