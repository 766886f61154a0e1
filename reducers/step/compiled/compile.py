"""Compilation of the kernel by numba, an optional package (`pip install 'sparsemor[fast]'`).

The functions of dense.py, kernel.py, local.py, reduced.py and prescribed.py are plain Python;
numba compiles copies of them, which call each other's compiled forms. Machine code is kept under a
digest of the sources, so that it is never older than these, where only its user can have written it
(`MachineCode`): numba's own files are pickles, found by an index that is a pickle.
"""

import hashlib
import inspect
import logging
import pickle
import platform
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple, TypeAlias

from sparsemor.core.protocols.poses import steered, tangent
from sparsemor.reducers.step import acceptance
from sparsemor.reducers.step.compiled import dense, kernel, local, prescribed, reduced
from sparsemor.reducers.step.compiled.machine_code import MachineCode

_log = logging.getLogger(__name__)
FUNCTIONS: tuple[Callable[..., object], ...] = (
    steered, tangent, acceptance.estimated_error, dense.product, dense.add_product,
    dense.add_products, local.evaluate_law, local.rows_of, reduced.motion, reduced.add_terms,
    reduced.begin, reduced.evaluate, reduced.add_bodies, reduced.residual, reduced.turns,
    reduced.turned, reduced.solution, reduced.relative_changes, reduced.reference_sizes,
    reduced.solve, reduced.remember, prescribed.corrected, prescribed.solve_body,
    prescribed.solve_prescribed, prescribed.add_forces, kernel.iterate_heat, kernel.solve_heat,
    kernel.free_motion, kernel.predict, kernel.predicted, kernel.accept, kernel.heat_ahead,
    kernel.advance)
"""Functions of the kernel, each after those that it calls."""
COUNTED: tuple[Callable[..., object], ...] = (
    dense.product, dense.add_products, local.rows_of, reduced.add_terms, prescribed.corrected,
    prescribed.solve_body, prescribed.solve_prescribed, prescribed.add_forces, kernel.iterate_heat,
    kernel.solve_heat)
"""Functions that create arrays. All others are compiled without the counts of references to arrays,
which take a third of a step."""


def left(*given: Any) -> int:
    """Instead of a function that solves what a model does not have."""
    return reduced.LEFT


def left_heat(*given: Any) -> tuple[int, float]:
    """Instead of the iteration of temperatures, where heat is linear."""
    return reduced.LEFT, 0.0


def not_ahead(*given: Any) -> bool:
    """Instead of temperatures of all steps at once, where that saves nothing."""
    return False


def no_rows(a: Any, *given: Any) -> Any:
    """Instead of the rows of terms, where there are none."""
    return a.offset


def nothing(*given: Any) -> None:
    """Instead of a part of a frame that no body has, or of the sum of no terms."""


Called: TypeAlias = tuple[Callable[..., object], tuple[Callable[..., object], ...]]
"""A function on arrays, and those that it calls, each after those that it calls itself."""


class Functions(NamedTuple):
    """Functions that belong to a model: that of its frames, None where no motion is unknown, and
    those of the laws of its terms. prescribed: True if it has bodies with prescribed motion; terms:
    True if its bodies with unknown motion have terms; unused: parts of frames that none of these
    has. What a model does not have is not compiled."""

    frame: Called | None
    laws: tuple[Called, ...]
    prescribed: bool = False
    terms: bool = False
    unused: tuple[Callable[..., object], ...] = ()

    @property
    def all(self) -> list[Callable[..., object]]:
        own = [self.frame] if self.frame is not None else []
        return [f for function, calls in (*own, *self.laws) for f in (*calls, function)]

    @property
    def instead(self) -> dict[Callable[..., object], Callable[..., object]]:
        """Functions with what replaces them."""
        found: dict[Callable[..., object], Callable[..., object]] = dict.fromkeys(
            self.unused, nothing)
        if self.frame is None:
            found[reduced.solve] = left
        if not self.prescribed:
            found |= {prescribed.solve_prescribed: left, prescribed.add_forces: nothing}
            if self.frame is not None:
                found[kernel.heat_ahead] = not_ahead
        if not self.terms:
            found[reduced.add_terms] = nothing
        if not self.laws:
            found |= {kernel.iterate_heat: left_heat, local.rows_of: no_rows}
        return found


def bound(
    functions: Functions, compiled: Callable[[FunctionType], Any],
    also: Sequence[Callable[..., object]] = (),
) -> dict[str, Any]:
    """Name -> function of the kernel with these functions, and of `also`, with `compiled` applied
    to all. numba resolves the names that a function calls when it compiles it, so that each is a
    copy whose global names are those of the functions that it shall call here."""
    made: dict[str, Any] = {}
    instead = functions.instead

    def with_calls(of: Called) -> Any:
        names: dict[str, Any] = {}
        for function in (*of[1], of[0]):
            names[function.__name__] = copied(function, names)
        return names[of[0].__name__]

    def copied(function: Callable[..., object], names: dict[str, Any]) -> Any:
        own = instead.get(function, function)
        assert isinstance(own, FunctionType)
        return compiled(FunctionType(own.__code__, {**own.__globals__, **names},
                                     own.__name__, own.__defaults__))

    made["evaluate_frame"] = with_calls(functions.frame or (reduced.evaluate_frame, ()))
    none = with_calls((local.no_law, ()))
    for i in range(local.LAWS):
        made[f"law_{i}"] = with_calls(functions.laws[i]) if i < len(functions.laws) else none
    for function in (*FUNCTIONS, *also):
        made[function.__name__] = copied(function, made)
    return made


def has_code(functions: Functions, checked: bool = False) -> bool:
    """True if an earlier run has kept machine code for models with these functions; checked: as in
    `compiled`."""
    return bool(MachineCode(name_of(functions, checked), make=False))


@cache
def compiled_advance(functions: Functions, checked: bool = False) -> Any:
    """Compiled `kernel.advance` for models with these functions; checked: as in `compiled`."""
    return compiled(functions, checked=checked)["advance"]


def compiled(
    functions: Functions, also: Sequence[Callable[..., object]] = (), creating: Any = None,
    checked: bool = False
) -> dict[str, Any]:
    """Name -> compiled function of the kernel with these functions, and of `also`; creating: one of
    these that creates arrays; checked: True for code that raises IndexError for each index outside
    its array, for models whose numbers come from elsewhere."""
    import numba  # optional, and takes half a second to import

    njit: Any = numba.njit  # its types lack `_nrt`
    kept = MachineCode(name_of(functions, checked))
    if not kept:
        _log.warning("compiling the time step once, some ten seconds; machine code: %s",
                     kept.folder or "not kept, since no folder is this user's alone")
    counted = {f.__code__ for f in (*COUNTED, no_rows, creating) if isinstance(f, FunctionType)}
    # sums may be reordered, which makes products several times faster
    return bound(functions, lambda f: with_kept_code(njit(
        error_model="numpy", boundscheck=checked, _nrt=f.__code__ in counted,
        fastmath={"contract", "reassoc"})(f), kept), also)


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
def name_of(functions: Functions, checked: bool = False) -> str:
    """Name of the machine code of the kernel with these functions: a digest of their sources and
    their order, of the versions of Python and numba, and of whether indices are checked."""
    own = functions.all
    files = sorted({__file__, *(inspect.getfile(f) for f in (*own, *FUNCTIONS))})
    frame = () if functions.frame is None else (functions.frame,)
    names = repr(([[f"{f.__module__}.{f.__qualname__}" for f in (function, *calls)]
                   for function, calls in (*frame, *functions.laws)],
                  sorted(f.__qualname__ for f in functions.instead)))
    versions = [platform.python_version(), *map(version, ("numba", "llvmlite", "numpy"))]
    sources = b"".join(Path(f).read_bytes() for f in files)
    about = names + repr(versions) + ("checked" if checked else "")
    return hashlib.sha256(sources + about.encode()).hexdigest()[:16]
