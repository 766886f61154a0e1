"""The contracts between parts. All arrays are float64 unless said otherwise; units are SI.

A plugin author reads this folder, one concept a file, and imports from here: where a contract is
kept may change, its name here does not. Configuration is a frozen `Plugin`; numbers live in what
its methods return. Nothing keeps state between calls: memory is passed in and handed back.
"""

from sparsemor.core.layout import Block, Layout
from sparsemor.core.mesh import Mesh
from sparsemor.core.protocols.contact import FrictionLaw, NormalLaw
from sparsemor.core.protocols.integration import (
    CautiousIntegrator,
    CurvedTimeFunction,
    Integrator,
    State,
    StepFormula,
    TimeFunction,
)
from sparsemor.core.protocols.linear_systems import Factorized, LinearOutcome, LinearSolver, Places
from sparsemor.core.protocols.parts import (
    BodyPart,
    BodyPlugin,
    ConnectorPlugin,
    MeshPlugin,
    NamesMultipliers,
    NotedPart,
    Part,
    ProbedBody,
    ReportsPassage,
)
from sparsemor.core.protocols.representation import (
    Basis,
    BlockData,
    ChecksBlock,
    Dictionary,
    Preconditioner,
    Sampler,
)
from sparsemor.core.protocols.sparse_recovery import (
    Group,
    SparseOutcome,
    SparseProblem,
    SparseSolver,
    SparseStart,
)
from sparsemor.core.protocols.steps import Redraws, Reducer, Resampling, StepOutcome, StepSolver
from sparsemor.core.protocols.terms import ReducedTerm, Term, TimeDependent, Trial

__all__ = [
    "Basis", "Block", "BlockData", "BodyPart", "BodyPlugin", "CautiousIntegrator", "ChecksBlock",
    "ConnectorPlugin", "CurvedTimeFunction", "Dictionary", "Factorized", "FrictionLaw", "Group",
    "Integrator", "Layout", "LinearOutcome", "LinearSolver", "Mesh", "MeshPlugin",
    "NamesMultipliers", "NormalLaw", "NotedPart", "Part", "Places", "Preconditioner", "ProbedBody",
    "Redraws", "ReducedTerm", "Reducer", "ReportsPassage", "Resampling", "Sampler",
    "SparseOutcome", "SparseProblem",
    "SparseSolver", "SparseStart", "State", "StepFormula", "StepOutcome", "StepSolver", "Term",
    "TimeDependent", "TimeFunction", "Trial",
]
