"""The quantities that an item of a paper file may name."""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from sparsemor.core.analysis.reproduction.error_quantities import Error, StudyValue
from sparsemor.core.analysis.reproduction.measure import Measure, Results
from sparsemor.core.analysis.reproduction.rules import Operand, evaluate
from sparsemor.core.analysis.reproduction.run_quantities import (
    ActiveAtoms,
    Cost,
    MeshCount,
    Parameter,
    RunStatus,
    Split,
    Summary,
)
from sparsemor.core.analysis.reproduction.state_quantities import (
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
