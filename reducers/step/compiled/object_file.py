"""Steps of a reduced model as an object file: the kernel compiled by numba with its arrays, for use
without Python."""

import platform
import re
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.core import FloatArray, InputError, require
from sparsemor.core.protocols.step_solver import MachineRequest, MachineSteps
from sparsemor.core.protocols.time_function import HeldValues, holding
from sparsemor.core.simulation.time_stepping import FixedStep
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from sparsemor.reducers.step.compiled import model_arrays, without_python
from sparsemor.reducers.step.compiled.compile import Functions, compiled, linked
from sparsemor.reducers.step.compiled.compiled_steps import CompiledSteps
from sparsemor.reducers.step.compiled.local_terms import LocalArrays
from sparsemor.reducers.step.compiled.time_functions import NotCompiled
from sparsemor.reducers.step.newton_loop import UNKNOWN
from sparsemor.reducers.step.step_memory import Memory

PROCESSORS = {"x86_64": "x86-64-v2", "amd64": "x86-64-v2"}
"""Processor, of those with the name of a machine, from which on the code runs; others: generic."""
AFFINE = 1e-9
"""Largest relative error of the effect of inputs, which must be linear."""
_ERRORS = re.compile(r"^declare (.*@(?:_?Py|numba_(?!xxgemv|attempt))\w+\(.*\)).*$", re.MULTILINE)
_DATA = re.compile(r"^(@_?Py\w+) = external global ([\w*%{}, ]+?)(?:, align \d+)?$", re.MULTILINE)
"""What numba's code calls and reads to raise errors of Python, which these functions do not."""
SOURCE = """
def step(F, I, B, T, u):
    f, i, b = carray(F, ({f},)), carray(I, ({i},)), carray(B, ({b},))
    timed, base = {timed}, {base}
    given({values}, {numbers}, carray(T, ({columns},)), carray(u, ({inputs},)), {by_input}, timed,
          base)
    return take({arrays}, RunArrays({run}), timed, base, {more})


def read(F, I, B, y):
    f, i, b = carray(F, ({f},)), carray(I, ({i},)), carray(B, ({b},))
    outputs({z}, {about}, {constants}, {weights}, carray(y, ({outputs},)))
    return 1
"""


class _Data:
    """Arrays in three long ones by type, and the expressions that find them there."""

    def __init__(self) -> None:
        self.kept: dict[str, list[NDArray[Any]]] = {"f": [], "i": [], "b": []}

    def put(self, value: Any) -> str:
        """Expression of a value in terms of f, i and b."""
        if isinstance(value, np.ndarray):
            kind = value.dtype.kind
            first = self.size(kind)
            self.kept[kind].append(np.ascontiguousarray(value).ravel())
            return f"{kind}[{first}:{first + value.size}].reshape({tuple(map(int, value.shape))})"
        if hasattr(value, "_fields"):
            return f"{type(value).__name__}({', '.join(map(self.put, value))})"
        if isinstance(value, tuple):
            return f"({''.join(f'{self.put(v)}, ' for v in value)})"
        return repr(value.item() if isinstance(value, np.generic) else value)

    def size(self, kind: str) -> int:
        return sum(a.size for a in self.kept[kind])

    def whole(self, kind: str, dtype: Any) -> Any:
        return np.concatenate([np.zeros(0, dtype), *self.kept[kind]]).astype(dtype)


def machine_steps(solver: BlockwiseSolver, of: MachineRequest[Memory]) -> MachineSteps:
    """Machine code and data of the steps of a solver. Raises InputError, with the reason, where
    they are not compiled."""
    require("numba", "fast", "steps in machine code")
    made: dict[str, Any] = {}

    def code(functions: Functions) -> Callable[..., int]:
        own = without_python
        made.update(compiled(
            functions, (own.take, own.given, own.outputs), own.differences_of_heat))
        return lambda *_: 0

    try:
        steps = CompiledSteps(solver, of.integrator.rules(of.h), of.h, code)
    except NotCompiled as error:
        raise InputError(f"its steps have no machine code: {error}", "reducer") from None
    data, n = _Data(), solver.layout.size
    run = {name: data.put(a) for name, a in _at_start(solver, steps, of)._asdict().items()}
    q, by_input, values = _in_time(steps, of, n)
    varying = np.flatnonzero(np.ptp(values, axis=0))
    k = len(steps.plan.arrays.solved)
    # arrays of `take`: bounds, and working arrays ahead, states, effort, J
    sizes = (3, 1, n), (1, len(steps.model.new), n), (1, 2), (k, k)
    more = np.full(1, np.inf), *map(np.zeros, sizes)
    expressions = {
        "z": run["z"], "timed": data.put(np.zeros((1, q))), "base": data.put(np.zeros((1, n))),
        "values": data.put(values[0]), "numbers": data.put(varying.astype(np.int64)),
        "by_input": data.put(by_input),
        "arrays": ", ".join(map(data.put, steps._arrays)), "run": ", ".join(run.values()),
        "more": ", ".join(map(data.put, more)), "about": data.put(of.about),
        "constants": data.put(of.numbers), "weights": data.put(of.weights)}
    source = SOURCE.format(
        **expressions, **{kind: max(data.size(kind), 1) for kind in "fib"}, columns=len(varying),
        inputs=len(of.inputs), outputs=len(of.about))
    return MachineSteps(
        _object(source, made), data.whole("f", np.float64), data.whole("i", np.int64),
        data.whole("b", np.bool_), np.ascontiguousarray(values[:, varying]),
        len(of.about))


def _at_start(
    solver: BlockwiseSolver, steps: CompiledSteps, of: MachineRequest[Memory]
) -> model_arrays.RunArrays:
    """The state of a run at its start, with the reference magnitudes of its first step. Raises
    InputError if that fails, and if the kernel in Python, whose indices are checked as they are not
    in machine code, finds arrays of the second step that do not fit each other."""
    memory, layout = of.memory.copy(), steps.solver.layout
    step = FixedStep.of(of.integrator, steps.solver, of.h)
    in_python = CompiledSteps(solver, of.integrator.rules(of.h), of.h, lambda functions: linked(
        functions, lambda function: function)["advance"])
    with np.errstate(all="ignore"):
        outcome, state, after = step(of.state, memory.copy())
        if not outcome.status.ok:
            raise InputError(f"its first step fails: {outcome.status.value} {outcome.detail}")
        try:
            in_python.advance(state, after.copy(), 1)
        except (IndexError, ValueError) as error:
            raise InputError(f"its arrays do not fit each other ({error})") from None
    kept, k, quaternions = after.kept, len(steps.plan.arrays.solved), len(layout.quaternions)
    run = steps._run_arrays(of.state, memory)
    return run._replace(
        top=kept.top, rate=kept.rate, noise=np.zeros(len(kept.top)), inverse=np.zeros((k, k)),
        spans=np.array(k * [[0, k]], dtype=np.int64).reshape(k, 2),
        attitudes=np.zeros((quaternions, 4, 4, 4)), effort=np.array([UNKNOWN, 0, 1]))


def _in_time(
    steps: CompiledSteps, of: MachineRequest[Memory], n: int
) -> tuple[int, FloatArray, FloatArray]:
    """Number q of functions of time; how they and the n rows change with each input (i, q + n); and
    their values (T, q + n) with the first values of the inputs. Raises InputError for inputs that
    act otherwise than linearly."""
    first, plan = np.array([f.start for f in of.inputs]), steps.plan

    def along(inputs: FloatArray, times: FloatArray) -> FloatArray:
        with holding(HeldValues(zip(of.inputs, inputs.tolist(), strict=True))):
            timed = plan.timed.along(times)
            return np.hstack((timed, plan.base_along(times, timed)))

    size, at = np.maximum(np.abs(first), 1.0), of.times[:1]
    rest = along(first, at)
    changes = np.array([(along(first + e * size, at) - rest)[0] / size.max(where=e > 0, initial=0.0)
                        for e in np.eye(len(first))]).reshape(len(first), rest.shape[1])
    found = along(first + 3.0 * size, of.times[-1:]) - along(first, of.times[-1:])
    wrong = np.abs(found - 3.0 * size @ changes)
    if (wrong > AFFINE * np.maximum(np.abs(found), np.abs(3.0 * size) @ np.abs(changes))).any():
        raise InputError("the inputs do not act linearly on the equations", "inputs")
    values = along(first, of.times)
    return rest.shape[1] - n, changes, values


def _object(source: str, functions: dict[str, Any]) -> bytes:
    """Object file of a source and the functions that it calls, for processors of this kind."""
    llvm: Any = import_module("llvmlite.binding")  # optional, as numba
    numba: Any = import_module("numba")
    types = numba.types
    names: dict[str, Any] = {**functions, "carray": numba.carray, **{
        c.__name__: c for c in vars(model_arrays).values() if isinstance(c, type)},
        "LocalArrays": LocalArrays}
    exec(compile(source, "steps", "exec"), names)  # written here, of shapes and numbers alone
    f, i, b = map(types.CPointer, (types.float64, types.int64, types.boolean))
    whole = None
    for name, given in (("step", (f, i, b, f, f)), ("read", (f, i, b, f))):
        made = numba.cfunc(types.int64(*given))(names[name])
        text = str(made._library._final_module).replace(made._wrapper_name, f"sparsemor_{name}")
        # functions that raise errors of Python, which are never called, get an empty body
        text = _DATA.sub(r"\1 = internal global \2 zeroinitializer", _ERRORS.sub(
            r"define internal \1 { unreachable }", text))
        module = llvm.parse_assembly(text)
        if whole is None:
            whole = module
        else:
            whole.link_in(module)
    assert whole is not None
    for function in whole.functions:
        if not function.is_declaration and not function.name.startswith("sparsemor_"):
            function.linkage = "internal"
    machine = platform.machine().lower()
    target = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(
        cpu=PROCESSORS.get(machine, "generic"), opt=3, reloc="pic", codemodel="default")
    return bytes(target.emit_object(whole))
