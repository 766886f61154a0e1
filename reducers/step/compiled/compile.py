"""Compilation of the kernel by numba, an optional package (`pip install 'sparsemor[fast]'`).

The functions of dense_products.py, kernel.py, local_terms.py and reduced_equations.py are plain
Python; numba compiles copies of them, which call each other's compiled forms. Machine code is kept
under a digest of the sources, so that it is never older than these, where only its user can have
written it (`MachineCode`): numba's own files are pickles, found by an index that is a pickle.
"""

import hashlib
import inspect
import logging
import pickle
import platform
from collections.abc import Callable, Sequence
from functools import cache, partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple, TypeAlias

from sparsemor.reducers.step.compiled import kernel, local_terms, reduced_equations
from sparsemor.reducers.step.compiled.machine_code import MachineCode

_log = logging.getLogger(__name__)
ArrayFunction: TypeAlias = Callable[..., object]
"""A function on arrays, which numba compiles."""
COUNTED: tuple[ArrayFunction, ...] = (
    local_terms.rows_of, reduced_equations.add_terms, kernel.iterate_heat)
"""Functions that create arrays. All others are compiled without the counts of references to arrays,
which take a third of a step."""


def nothing(*given: Any) -> None:
    """Instead of a part of a frame that no body has."""


class Functions(NamedTuple):
    """Functions on arrays that belong to a model: that of its frames, None where no motion is
    unknown, and those of the laws of its terms. unused: parts of frames that none of these has."""

    frame: ArrayFunction | None
    laws: tuple[ArrayFunction, ...]
    unused: tuple[ArrayFunction, ...] = ()

    @property
    def instead(self) -> dict[ArrayFunction, ArrayFunction]:
        """Function of the kernel -> what is compiled in its place."""
        found: dict[ArrayFunction, ArrayFunction] = dict.fromkeys(self.unused, nothing)
        if self.frame is not None:
            found[reduced_equations.evaluate_frame] = self.frame
        return found


def linked(
    functions: Functions, compiled: Callable[[FunctionType], Any],
    wanted: Sequence[ArrayFunction] = (kernel.advance,),
) -> dict[str, Any]:
    """Name -> function of the kernel, and each that it calls, for a model with these functions and
    with `compiled` applied. numba resolves the names that a function calls when it compiles it, so
    that each is a copy whose global names are those of the functions that it shall call here."""
    replacements, copies = functions.instead, dict[object, Any]()

    def link(function: ArrayFunction) -> Any:
        source = replacements.get(function, function)
        if source not in copies:
            copies[source] = copied(source, "", {})
        return copies[source]

    def copied(source: ArrayFunction, suffix: str, names: dict[str, Any]) -> Any:
        assert isinstance(source, FunctionType)
        called = {n: f for n in source.__code__.co_names if n not in names
                  and isinstance(f := source.__globals__.get(n), FunctionType)}
        copy = FunctionType(
            source.__code__,
            {**source.__globals__, **{n: link(f) for n, f in called.items()}, **names},
            source.__name__, source.__defaults__)
        copy.__qualname__ += suffix
        return compiled(copy)

    laws = link(local_terms.no_law)
    # a chain: the copy for law i calls it, or the copy for law i + 1 for a higher number
    for i, law in reversed([*enumerate(functions.laws)]):
        laws = copied(
            local_terms.evaluate_law, f"_{i}", {"first_law": link(law), "other_laws": laws})
    copies[local_terms.evaluate_law] = laws
    for function in wanted:
        link(function)
    return {function.__name__: copy for function, copy in copies.items()
            if isinstance(function, FunctionType)}


def has_code(functions: Functions, checked: bool = False) -> bool:
    """True if an earlier run has kept machine code for models with these functions; checked: as in
    `compiled`."""
    return bool(MachineCode(name_of(functions, checked), make=False))


@cache
def compiled_advance(functions: Functions, checked: bool = False) -> Any:
    """Compiled `kernel.advance` for models with these functions; checked: as in `compiled`."""
    return compiled(functions, checked=checked)["advance"]


def compiled(
    functions: Functions, wanted: Sequence[ArrayFunction] = (kernel.advance,),
    creating: Any = None, checked: bool = False
) -> dict[str, Any]:
    """Name -> compiled function of the kernel with these functions; wanted: those that are called
    from outside; creating: one that creates arrays, besides `COUNTED`; checked: True for code that
    raises IndexError for each index outside its array, for models whose numbers come from
    elsewhere."""
    import numba  # optional, and takes half a second to import

    njit: Any = numba.njit  # its types lack `_nrt`
    kept = MachineCode(name_of(functions, checked))
    if not kept:
        _log.warning(
            "compiling the time step, once for all models of this kind, up to a minute "
            "(reducer.compiled: off leaves it out); machine code: %s",
            kept.folder or "not kept, since no folder is this user's alone")
    counted = {f.__code__ for f in (*COUNTED, creating) if isinstance(f, FunctionType)}
    outer = {f.__code__ for f in wanted if isinstance(f, FunctionType)}

    def made(f: FunctionType) -> Any:
        # sums may be reordered, which makes products several times faster; _nrt: references to
        # arrays are counted, where some are created
        options = {"error_model": "numpy", "boundscheck": checked, "_nrt": f.__code__ in counted,
                   "fastmath": {"contract", "reassoc"}}
        return with_kept_code(njit(**options)(f), kept) if f.__code__ in outer else inlined(
            njit(**options, no_cpython_wrapper=True, no_cfunc_wrapper=True)(f))

    return linked(functions, made, wanted)


def inlined(compiled: Any) -> Any:
    """The compiled function as a part of those that call it, optimized with them and without
    machine code of its own. numba optimizes and translates each function that is compiled, and once
    more where it is called: two fifths of the time."""
    dynfunc: Any = import_module("numba._dynfunc")  # optional
    make = compiled._compiler._compile_core

    def without_code(flags: Any) -> Any:
        flags.no_compile = True
        return flags

    def compile_core(args: Any, return_type: Any) -> Any:
        result = make(args, return_type)
        described, library = result.fndesc, result.library
        library._optimize_final_module = nothing
        library._finalize_final_module = partial(setattr, library, "_finalized", True)
        # never called: the key by which the linker finds the function
        key = dynfunc.make_function(described.lookup_module(), described.qualname, "", 0,
                                    result.environment, (library,))
        result.target_context.insert_user_function(key, described, [library])
        return result._replace(entry_point=key)

    compiled._compiler._customize_flags = without_code
    compiled._compiler._compile_core = compile_core
    return compiled


def with_kept_code(compiled: Any, kept: MachineCode) -> Any:
    """The compiled function, with its machine code taken from `kept` where that has it."""
    caching, serialize, compiler = (import_module(f"numba.core.{m}") for m in (
        "caching", "serialize", "compiler"))  # optional

    class NumbaCache(caching._Cache):  # type: ignore[misc, name-defined]
        """Cache of one function for numba: machine code in `kept`, by a key of its types, the
        processor, its name and the digest of its byte code."""

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

    compiled._cache = NumbaCache()
    return compiled


@cache
def name_of(functions: Functions, checked: bool = False) -> str:
    """Name of the machine code of the kernel with these functions: a digest of their sources and
    their order, of the versions of Python and numba, and of whether indices are checked."""
    included = linked(functions, lambda function: function).values()
    files = sorted({__file__, *map(inspect.getfile, included)})
    laws = [f"{f.__module__}.{f.__qualname__}" for f in (functions.frame, *functions.laws) if f]
    names = repr((laws, sorted(f.__qualname__ for f in functions.instead)))
    versions = [platform.python_version(), *map(version, ("numba", "llvmlite", "numpy"))]
    sources = b"".join(Path(f).read_bytes() for f in files)
    about = names + repr(versions) + ("checked" if checked else "")
    return hashlib.sha256(sources + about.encode()).hexdigest()[:16]
