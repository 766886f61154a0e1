"""Rules for the names that a scene gives to its bodies, joints, contacts, loads, probes and
parameters."""

import re
from collections.abc import Mapping
from typing import Any

from pydantic_core import InitErrorDetails

from sparsemor.core.registry.registry import suggestions
from sparsemor.core.registry.validation_errors import custom

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_OWN = ("probes", "parameters")
"""Groups whose names may be those of another group, too."""
_NAMED = ("bodies", "joints", "contacts", "loads", *_OWN)
LONGEST = 100
"""Largest number of characters of a name."""
RESERVED = "ground"
"""Name of the fixed world in joints."""


def name_faults(data: Mapping[str, Any]) -> list[InitErrorDetails]:
    """Faults of all names that break a rule, and of probes of bodies that do not exist."""
    owners: dict[object, str] = {}
    lines: list[InitErrorDetails] = []
    groups = {g: data[g] for g in _NAMED if isinstance(data.get(g), Mapping)}
    for group, entries in groups.items():
        for name in entries:
            complaint = _complaint(group, name, owners)
            if complaint:
                lines.append(custom("name", complaint, (group, str(name)), name))
    bodies = sorted(map(str, groups.get("bodies", {})))
    for name, probe in groups.get("probes", {}).items():
        body = probe.get("body") if isinstance(probe, Mapping) else None
        if isinstance(body, str) and body not in bodies:
            message = f"no body is called {body!r}: {suggestions(body, bodies, 'bodies')}"
            lines.append(custom("name", message, ("probes", str(name), "body"), body))
    return lines


def _complaint(group: str, name: object, owners: dict[object, str]) -> str:
    if not (isinstance(name, str) and _NAME.fullmatch(name)):
        return f"a name is made of letters, digits and _, and starts with no digit (got {name})"
    if len(name) > LONGEST:  # files of the result are called by it
        return f"a name has at most {LONGEST} characters (this one has {len(name)})"
    if name == RESERVED:
        return f"{RESERVED} means the fixed world: choose another name"
    if group in _OWN:
        return ""
    if name in owners:
        return (f"this name is taken in {owners[name]}: bodies, joints, contacts and loads share "
                "their names")
    owners[name] = group
    return ""
