"""Export of a kept model whose steps need no Python: a functional mock-up unit (FMI 2.0,
co-simulation), or a library in C."""

import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as xml

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.results.atomic_files import replace_file
from sparsemor.core.results.probes import ProbeReader
from sparsemor.core.simulation.sensors_and_outputs import StepperOutput
from sparsemor.plugins.export.export_plan import make_folder
from sparsemor.plugins.kept_models.co_simulation import ModelStepper
from sparsemor.plugins.kept_models.reduced_model import ReducedModel

PLATFORMS = {("linux", True): "linux64", ("win32", True): "win64", ("darwin", True): "darwin64"}
"""Folders of FMI 2.0 for binaries, by system and 64 bits."""
SUFFIX = {"linux64": ".so", "win64": ".dll", "darwin64": ".dylib"}
STATE, AFFINE, POSITION = 0, 1, 2
"""Kinds of outputs (reducers/step/compiled/without_python.py:outputs)."""


SOURCES = ("model.h", "model.c", "example.c")
"""Files of a model in C, with the object file steps.o, data.bin, and sizes.h."""


@dataclass(frozen=True, slots=True, eq=False)
class ExportedModel:
    """A written FMU, or folder of a model in C: inputs, outputs and outputs of the model that it
    does not have, by name."""

    file: Path
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    left_out: tuple[str, ...]


def export_fmu(
    model: ReducedModel, file: str | Path, inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
) -> ExportedModel:
    """Writes a model as an FMU with its steps in machine code of this kind of computer.

    inputs: keys of functions of time of loads and joints, by default all; outputs: names as of
    `ReducedModel.stepper`, by default all that are functions of the state alone. Raises InputError
    for others, for a model without compiled steps, and without a compiler.
    """
    made = _Made(model, inputs, outputs)
    name = _identifier(model.scene.name)
    folder = _platform()
    with tempfile.TemporaryDirectory() as work:
        library = Path(work) / f"{name}{SUFFIX[folder]}"
        steps = made.steps
        guid = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, steps.code.hex() + str(made.keys))}}}"
        made.write(Path(work), GUID=f'"{guid}"')
        _build(Path(work), library)
        described = _description(model, made.stepper, name, guid, made.keys, made.names)
        packed = Path(work) / "model.fmu"
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as unit:
            _write(unit, "modelDescription.xml", described)
            _write(unit, f"binaries/{folder}/{library.name}", library.read_bytes())
        replace_file(Path(file), packed.read_bytes())
    return made.unit(Path(file))


def export_c(
    model: ReducedModel, folder: str | Path, inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
) -> ExportedModel:
    """Writes a model as a library in C into a new folder: its interface model.h, and an object file
    of its steps for this kind of computer; example.c says how to build it. Arguments and errors as
    of `export_fmu`; no compiler is needed."""
    made, target = _Made(model, inputs, outputs), Path(folder)
    make_folder(target)
    made.write(target)
    for name in SOURCES:
        shutil.copy(Path(__file__).with_name(name), target)
    return made.unit(target)


class _Made:
    """Steps of a model in machine code with its inputs and outputs. keys: inputs, by the keys of
    their functions of time; names: outputs; left_out: those that the code cannot evaluate."""

    def __init__(
        self, model: ReducedModel, inputs: Sequence[str] | None, outputs: Sequence[str] | None
    ) -> None:
        """inputs, outputs: their names, all by default. Raises InputError for an output that is no
        function of the state alone, and for a model without compiled steps."""
        self.keys = model.possible_inputs if inputs is None else tuple(inputs)
        self.stepper, about = model.stepper(self.keys, outputs or ()), _Outputs()
        described = self.stepper.described
        # about: tables by which the code evaluates the outputs that it can
        self.left_out = tuple(n for n, out in described.items() if not about.add(n, out))
        if outputs and self.left_out:
            raise InputError(f"{', '.join(self.left_out)}: not a function of the state alone, as "
                             "an output in machine code must be", "outputs")
        self.names = about.names
        self.steps = self.stepper.machine_steps(*about.arrays())

    def write(self, folder: Path, **more: str) -> None:
        """Writes steps.o, data.bin (reals, table, integers, flags, as model.c reads them) and
        sizes.h, with exact numbers as hexadecimals. more: further definitions, name -> value."""
        steps, stepper = self.steps, self.stepper
        (folder / "steps.o").write_bytes(steps.code)
        (folder / "data.bin").write_bytes(b"".join(
            a.tobytes() for a in (steps.reals, steps.table, steps.integers, steps.flags)))
        first = ", ".join(v.hex() for v in stepper.inputs.values()) or "0"
        rows, columns = steps.table.shape if steps.table.size else (0, 0)
        sizes = {
            "REALS": steps.reals.size, "INTEGERS": steps.integers.size, "FLAGS": steps.flags.size,
            "INPUTS": len(self.keys), "OUTPUTS": steps.outputs, "ROWS": rows, "COLUMNS": columns,
            "STEP": stepper.step_size.hex(),
            "NAMES": "".join(f"{json.dumps(n)}, " for n in (*self.keys, *self.names)), **more}
        (folder / "sizes.h").write_text("".join(f"#define {k} {v}\n" for k, v in sizes.items())
                                        + f"static const double FIRST[] = {{{first}}};\n")

    def unit(self, file: Path) -> ExportedModel:
        return ExportedModel(file, tuple(self.keys), tuple(self.names), self.left_out)


def _write(unit: zipfile.ZipFile, name: str, data: bytes) -> None:
    entry = zipfile.ZipInfo(name)  # without the time of writing: equal models give equal bytes
    entry.external_attr, entry.compress_type = 0o644 << 16, zipfile.ZIP_DEFLATED
    unit.writestr(entry, data)


class _Outputs:
    """Arrays of the outputs."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.about: list[list[int]] = []
        self.numbers: list[list[float]] = []
        self.weights: list[float] = []

    def add(self, name: str, of: StepperOutput) -> bool:
        """Adds an output; False for one that is no function of the state alone. Each has 8 whole
        numbers, of which the first is its kind, and 10 real ones. Those of an entry of the state
        (`STATE`) are its row (0: unknowns, 1: rates) and column."""
        row: list[int] = [STATE, int(of.rate), of.at]
        numbers: list[float] = []
        if of.reader is not None:
            found = self._of_probe(of.reader, of.at) if isinstance(of.reader, ProbeReader) else None
            if found is None:
                return False
            row, numbers = found
        self.names.append(name)
        self.about.append(row + [0] * (8 - len(row)))
        self.numbers.append(numbers + [0.0] * (10 - len(numbers)))
        return True

    def _of_probe(self, probe: ProbeReader, at: int) -> tuple[list[int], list[float]] | None:
        """Whole and real numbers by which the C code evaluates component `at` of a probe; None for
        one that it cannot. Components: d positions, d displacements, temperature, if it has them.

        `AFFINE`, temperature or displacement: first unknown, number k of unknowns, first of their k
        weights; constant part. `POSITION`: component, d, first rigid coordinate (-1 for a fixed
        pose), number of coordinates of the pose, first elastic unknown, their number k, first of
        their k d weights; point (3,), m, and the fixed pose.
        """
        d, u = len(probe.place.point), probe.displacement
        if at >= d * (1 + (u is not None)) + (probe.temperature is not None):
            return None  # a stress
        if at >= d:
            part = u if at < 2 * d and u is not None else probe.temperature
            column = at - d if part is u else 0
            if part is None or part is not u and probe.place.given:
                return None
            start = self._kept(part.weights[:, column])
            return [AFFINE, part.at.start, part.at.stop - part.at.start, start], [
                float(part.base[column])]
        if probe.rigid is None and probe.place.guide is not None:
            return None
        rest = np.zeros(d) if u is None else u.base
        point = [*(probe.place.point + rest).tolist(), 0.0][:3]
        pose: list[float] = [] if probe.rigid is not None else np.asarray(
            probe.place.pose).tolist()
        size = len(pose) if probe.rigid is None else probe.rigid.stop - probe.rigid.start
        first, k, start = (0, 0, 0) if u is None else (
            u.at.start, u.at.stop - u.at.start, self._kept(u.weights.ravel()))
        return [POSITION, at, d, -1 if probe.rigid is None else probe.rigid.start, size, first, k,
                start], [*point, *pose]

    def _kept(self, weights: FloatArray) -> int:
        self.weights += weights.tolist()
        return len(self.weights) - len(weights)

    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return (np.array(self.about, dtype=np.int64).reshape(-1, 8),
                np.array(self.numbers).reshape(-1, 10), np.array(self.weights))


def _identifier(name: str) -> str:
    found = re.sub(r"\W", "_", name, flags=re.ASCII)
    return found if found[:1].isalpha() or found[:1] == "_" else f"model_{found}"


def _platform() -> str:
    key = sys.platform, sys.maxsize > 2**32
    if key not in PLATFORMS or platform.machine().lower() not in ("x86_64", "amd64"):
        raise InputError(f"FMI 2.0 has no binaries for {sys.platform}, {platform.machine()}", "to")
    return PLATFORMS[key]


def _compiler() -> list[str]:
    """Command of a C compiler. Raises InputError if there is none."""
    for name in filter(None, (os.environ.get("CC"), "cc", "gcc", "clang")):
        if found := shutil.which(name):
            return [found]
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc"]
    raise InputError("an FMU needs a C compiler: install gcc or clang, or pip install "
                     "'sparsemor[fmu]'", "to")


def _build(work: Path, library: Path) -> None:
    """Compiles and links the library of the model in the folder `work`."""
    for name in ("model.h", "model.c", "fmi2.c"):
        shutil.copy(Path(__file__).with_name(name), work)
    whole = [] if sys.platform == "darwin" else ["-Wl,--no-undefined"]
    command = [*_compiler(), "-O2", "-shared", "-fPIC", "-fvisibility=hidden", "-s", *whole,
               "fmi2.c", "steps.o", "-lm", "-o", library.name]
    done = subprocess.run(command, cwd=work, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InputError(f"the C compiler {command[0]} failed: {done.stderr.strip()[-500:]}", "to")


def _description(
    model: ReducedModel, stepper: ModelStepper, name: str, guid: str, inputs: Sequence[str],
    outputs: Sequence[str],
) -> bytes:
    """The file modelDescription.xml."""
    scene, units = model.scene, stepper.outputs
    root = xml.Element("fmiModelDescription", fmiVersion="2.0", modelName=scene.name, guid=guid,
                       description=scene.title, generationTool="sparsemor",
                       variableNamingConvention="flat", numberOfEventIndicators="0")
    xml.SubElement(
        root, "CoSimulation", modelIdentifier=name, needsExecutionTool="false",
        canHandleVariableCommunicationStepSize="true", canGetAndSetFMUstate="true",
        canSerializeFMUstate="true", maxOutputDerivativeOrder="0")
    known = dict.fromkeys(units[n] for n in outputs)
    if known:
        defined = xml.SubElement(root, "UnitDefinitions")
        for unit in known:
            xml.SubElement(defined, "Unit", name=unit)
    categories = xml.SubElement(root, "LogCategories")
    xml.SubElement(categories, "Category", name="logStatusError")
    xml.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime=repr(scene.time.end),
                   stepSize=repr(stepper.step_size))
    variables = xml.SubElement(root, "ModelVariables")
    for i, key in enumerate(inputs):
        one = xml.SubElement(variables, "ScalarVariable", name=key, valueReference=str(i),
                             causality="input", variability="continuous")
        xml.SubElement(one, "Real", start=repr(stepper.inputs[key]))
    for i, output in enumerate(outputs, len(inputs)):
        one = xml.SubElement(variables, "ScalarVariable", name=output, valueReference=str(i),
                             causality="output", variability="continuous", initial="calculated")
        xml.SubElement(one, "Real", unit=units[output])
    structure = xml.SubElement(root, "ModelStructure")
    for part in ("Outputs", "InitialUnknowns") if outputs else ():
        listed = xml.SubElement(structure, part)
        for i in range(len(outputs)):
            xml.SubElement(listed, "Unknown", index=str(len(inputs) + i + 1))
    xml.indent(root)
    return xml.tostring(root, encoding="unicode").encode()
