"""Quantities of interest: numbers of a run, computed from its stored result."""

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from pydantic import model_validator

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.registry.registry import suggestions
from sparsemor.core.results.result_variables import FIELDS
from sparsemor.core.results.run_result import RunResult
from sparsemor.plugins.charts.fields import nodal_values

Take = Literal["max", "min", "largest", "final", "mean", "integral", "time_of_max"]
FORMS = ("probe", "joint", "contact", "field")
TAKEN: Mapping[Take, Callable[[FloatArray, FloatArray], float]] = {
    "max": lambda t, y: float(y.max()),
    "min": lambda t, y: float(y.min()),
    "largest": lambda t, y: float(np.abs(y).max()),
    "final": lambda t, y: float(y[-1]),
    "mean": lambda t, y: _integral(t, y) / float(t[-1] - t[0]) if len(t) > 1 else float(y[0]),
    "integral": lambda t, y: _integral(t, y),
    "time_of_max": lambda t, y: float(t[y.argmax()]),
}
"""Number of a history y (j,) at stored times t (j,), s; integrals by the trapezoidal rule."""


class QuantityOfInterest(Plugin):
    """One number of a run, from a history at its stored times: a component of a probe, a joint
    force, a resultant of a contact, or the extreme of a field over the nodes of a body."""

    probe: str = ""
    """Name of a probe."""
    joint: str = ""
    """Name of a joint; without `component` the norm of its forces, N, or of a force element its
    tension, N, or torque, N m, without sign."""
    contact: str = ""
    """Name of a contact."""
    field: Literal["", "displacement", "temperature", "stress", "strain"] = ""
    """Field of a body: |displacement| (m), temperature (K), von Mises stress (Pa), equivalent
    strain; its maximum over the nodes, with `take: min` its minimum."""
    body: str = ""
    """Body of the field."""
    component: str = ""
    """Component of a probe (`x`, `u_y`, `temperature`), a joint or a contact (`pressure`)."""
    take: Take = "max"
    """What is taken of the history; `largest`: of absolute values."""

    @model_validator(mode="after")
    def _one_form(self) -> "QuantityOfInterest":
        given = [form for form, name in zip(FORMS, (
            self.probe, self.joint, self.contact, self.field), strict=True) if name]
        if len(given) != 1:
            raise InputError(f"give exactly one of {', '.join(FORMS)}")
        if bool(self.field) is not bool(self.body):
            raise InputError("a field is that of a body: give `field` and `body`", "body")
        if not self.component and (self.probe or self.contact):
            raise InputError(f"name the component of the {given[0]}", "component")
        return self

    @property
    def names(self) -> Mapping[str, str]:
        """Table of the scene -> name in it that the quantity needs."""
        found = {"probes": self.probe, "joints": self.joint, "contacts": self.contact,
                 "bodies": self.body}
        return {table: name for table, name in found.items() if name}

    def of(self, result: RunResult) -> float:
        """Value for a run. Raises InputError where its result has no such history."""
        t, y = self._history(result)
        return TAKEN[self.take](t, y)

    def _history(self, result: RunResult) -> tuple[FloatArray, FloatArray]:
        """Times (j,), s, and values (j,) of the probe, contact, joint or field that the quantity
        names; of a joint without a component the norm of its forces, N."""
        times = result.times
        if self.probe:
            components = result.probe_header(self.probe).components
            return times, result.probe(self.probe)[:, components.index(
                _known(self.component, components, "component"))]
        if self.contact:
            contacts = result.contacts()
            history = contacts[_known(self.contact, contacts, "contact")]
            return history["time"], history[_known(self.component, [
                n for n in history if n != "time"], "component")]
        if self.joint:
            joints = result.joint_forces()
            forces = joints[_known(self.joint, joints, "joint")]  # (name, unit) -> values (j,)
            if self.component:
                named = {name: values for (name, _), values in forces.items()}
                return times, named[_known(self.component, named, "component")]
            one = result.element_forces.get(self.joint)
            if one is not None:  # multipliers of its flexible sides repeat it
                return times, np.abs(forces[one])
            return times, np.sqrt(np.sum([
                v**2 for (_, unit), v in forces.items() if unit == "N"], axis=0))
        extreme = np.min if self.take == "min" else np.max
        return times, np.array([extreme(nodal_values(result, self.body, i, FIELDS[self.field]))
                                for i in range(len(times))])


def _integral(t: FloatArray, y: FloatArray) -> float:
    return float(0.5 * np.diff(t) @ (y[1:] + y[:-1]))


def _known(name: str, names: "Mapping[str, object] | tuple[str, ...] | list[str]", key: str) -> str:
    if name not in names:
        raise InputError(f"none is called {name!r}: {suggestions(name, list(names), 'there are')}",
                         key)
    return name
