"""The quantities that an item of a paper file may name."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from sparsemor.plugins.liang2026.error_quantities import Error, StudyValue
from sparsemor.plugins.liang2026.measure import Measure, Results
from sparsemor.plugins.liang2026.rules import Operand, evaluate
from sparsemor.plugins.liang2026.run_quantities import (
    ActiveAtoms,
    Cost,
    MeshCount,
    Parameter,
    RunStatus,
    Split,
    Summary,
)
from sparsemor.plugins.liang2026.state_quantities import (
    ContactValue,
    FieldValue,
    Position,
    ProbeValue,
    Rotation,
)


class Formula(Measure):
    """Number computed from other values of the item."""

    use: Literal["formula"]
    text: str
    """Arithmetic on earlier names, such as `a / b`."""

    def compute(self, results: Results, known: Mapping[str, Operand]) -> Operand:
        return evaluate(self.text, known)


Quantity = Annotated[
    Formula | Error | FieldValue | Rotation | Position | ProbeValue | ContactValue | Cost | Split
    | RunStatus | Summary | Parameter | MeshCount | ActiveAtoms | StudyValue,
    Field(discriminator="use")]
"""A quantity of a paper file: `{use: error, run: a, reference: b}`."""
