"""Nodal loads of another code: a load vector of a body from matrices, times a function of time."""

from collections.abc import Mapping

from sparsemor.bodies.body_set import find_body
from sparsemor.bodies.loads.built_load import LoadPart, NumberOrFunction, amplitude
from sparsemor.bodies.matrices.matrix_body import MatrixBody
from sparsemor.core import Equations, InputError, LoadPlugin, Part, suggestions


class LoadVector(LoadPlugin):
    """Nodal forces, moments and heat of a load vector of a body from matrices; they turn with the
    body frame."""

    on: str
    """Load vector `body:name`, of the option `load_vectors` of the body."""
    factor: NumberOrFunction | None = None
    """Function of time that multiplies the load; 1 by default."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        """The named load vector of a body from matrices, times `factor`; as it may act on all
        nodes, hyper-reduction need not keep its rows (localized=False). vector: nodal forces,
        moments and heat. InputError under `on`."""
        owner, _, which = self.on.partition(":")
        body = find_body(parts, owner, "on")
        if not isinstance(body, MatrixBody):
            raise InputError(f"body {owner!r} is not from `matrices`, and has no load vectors",
                             "on")
        if which not in body.load_vectors:
            raise InputError(f"body {owner!r} has no load vector {which!r}: "
                             f"{suggestions(which, list(body.load_vectors), 'load_vectors')}", "on")
        f, vector = amplitude(self.factor), body.load_vectors[which]
        if vector.heat.any() and body.heat is None:
            raise InputError(f"{self.on!r} has heat, and body {owner!r} has no thermal field", "on")
        if not vector.heat.any() and body.immobile:
            raise InputError(f"body {owner!r} neither moves nor deforms, so a force on it does "
                             "nothing", "on")

        def write(equations: Equations) -> None:
            body.load_vector(equations, vector, f)

        return LoadPart(name, write, localized=False)
