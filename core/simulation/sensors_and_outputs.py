"""Quantities of a run that are read between its steps: outputs of a stepper, sensors of
controllers."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.poses import COORDINATE_UNITS, COORDINATES
from sparsemor.core.results.probes import ForceReader, ProbeReader, rate_columns


@dataclass(frozen=True, slots=True, eq=False)
class StepperOutput:
    """Quantity that a stepper gives: its unit, and the column `at` of what a probe or a force
    element gives, or of the unknowns x (rate: of their rates)."""

    unit: str
    at: int
    reader: ProbeReader | ForceReader | None = None
    rate: bool = False


def outputs_of(
    layout: Layout, multipliers: Mapping[str, Sequence[tuple[str, str]]],
    probes: Iterable[ProbeReader], forces: Iterable[ForceReader],
) -> Mapping[str, StepperOutput]:
    """Name -> quantity of all that a run records and of its rigid coordinates: `tip.u_y` of probe
    tip, `crank.rigid.angle` and `crank.rigid.angle_rate` of a body, `hinge.force_x` of a joint.
    multipliers: block of multipliers -> name and unit of each."""
    found = dict[str, StepperOutput]()
    # unit, then column of what the reader gives, or without a reader of the unknowns (rate: rates)
    for p in probes:
        head = p.header()
        found |= {output_name(p.name, c): StepperOutput(unit, i, p)
                  for i, (c, unit) in enumerate(zip(head.components, head.units, strict=True))}
    for f in forces:
        found[output_name(f.name, f.component[0])] = StepperOutput(f.component[1], 0, f)
    for b in layout:
        first = layout[b.name].start
        if b.name in multipliers:
            found |= {output_name(b.owner, name): StepperOutput(unit, first + i)
                      for i, (name, unit) in enumerate(multipliers[b.name])}
        elif b.kind.quantity is Quantity.POSE:
            for i, name in enumerate(COORDINATES.get(b.size, ())):
                unit = COORDINATE_UNITS[name]
                found[f"{b.name}.{name}"] = StepperOutput(unit, first + i)
                found[f"{b.name}.{name}_rate"] = StepperOutput(f"{unit}/s", first + i, rate=True)
    return found


def output_name(part: str, component: str) -> str:
    """Name of a component of what a part gives: hinge and force x -> `hinge.force_x`."""
    return f"{part}.{component.replace(' ', '_')}"


def read(outputs: Sequence[StepperOutput], s: State) -> FloatArray:
    """Present values of outputs in a state of the step solver."""
    by_reader, values = dict[int, FloatArray](), list[float]()
    for output in outputs:
        if output.reader is None:
            values.append(float((s.v if output.rate else s.x)[output.at]))
            continue
        if id(output.reader) not in by_reader:
            # readers take rows of states, a force element also the rates of its columns of x
            t, x = np.array([s.t]), s.x[None]
            by_reader[id(output.reader)] = np.atleast_1d(np.squeeze(
                output.reader(t, x) if isinstance(output.reader, ProbeReader) else output.reader(
                    t, x, {first: s.v[None, at] for first, at in rate_columns(
                        [output.reader]).items()}), axis=0))
        values.append(float(by_reader[id(output.reader)][output.at]))
    return np.array(values)
