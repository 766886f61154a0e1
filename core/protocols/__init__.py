"""Contracts of the parts of a simulation, and the data that they pass to each other. Arrays are
float64 unless said otherwise; units are SI.

One file per concept; a contract is a class from which plugins, and the objects that they build,
derive: what has no default must be written. A plugin is a frozen set of options; the objects that
its methods return hold the numbers. Plugins and solvers keep no state between calls: a time step
writes only to the memory passed to it.
"""

from sparsemor.core.protocols.basis import Basis, BlockData, Dictionary
from sparsemor.core.protocols.body import (
    Body,
    BodyPlugin,
    BodyShape,
    Material,
    MaterialProperties,
    MeanTemperature,
    Part,
    ProbePlace,
    StressConstants,
    StressRecovery,
    TemperatureProperty,
)
from sparsemor.core.protocols.body_frame import (
    BodyFrame,
    Frame,
    FrameArrays,
    FrameItem,
    FrameWork,
)
from sparsemor.core.protocols.connector import (
    Connector,
    ConnectorPlugin,
    Effect,
    Load,
    LoadPlugin,
)
from sparsemor.core.protocols.contact import (
    Contact,
    ContactPlugin,
    FrictionLaw,
    NormalLaw,
)
from sparsemor.core.protocols.contributions import (
    BodyRecord,
    ConstraintRecord,
    Equations,
    FrameRecord,
    LocalRecord,
    MatrixRecord,
    Origin,
    Records,
    TableRecord,
    VectorRecord,
)
from sparsemor.core.protocols.integrator import (
    Function,
    Integrator,
    NextStep,
    Solve,
    State,
    StepFormula,
    StepOutcome,
    TimeFunction,
    UpdateRule,
    UpdateRules,
)
from sparsemor.core.protocols.joint import (
    ForceLaw,
    Joint,
    JointPlugin,
    RecordedForce,
)
from sparsemor.core.protocols.layout import Block, FieldKind, Layout, Quantity
from sparsemor.core.protocols.linear_solver import (
    DofLocations,
    Factorized,
    LinearOutcome,
    LinearSolver,
)
from sparsemor.core.protocols.load_tables import LoadTable, Table, Tabled, TabledAlong
from sparsemor.core.protocols.mesh import BodySize, Mesh, MeshPlugin, MeshSize
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.protocols.prescribed_motion import FrameHistory, Stage, SurfaceLoads
from sparsemor.core.protocols.prescribed_quantities import Differentiable, Held, Prescribed
from sparsemor.core.protocols.reducer import (
    AssembledModel,
    BlockBases,
    BlockBudget,
    BlockLinearSolvers,
    Choice,
    ErrorAction,
    ErrorEstimator,
    ErrorLimit,
    OfflineProducts,
    Recording,
    ReducedProblem,
    Reducer,
    StepFactors,
    TrialRun,
)
from sparsemor.core.protocols.sampler import (
    Preconditioner,
    RowsKept,
    Sampler,
)
from sparsemor.core.protocols.separable import (
    Amplitude,
    ElasticIntegrals,
    ElasticLocal,
    ElasticOperators,
    HeatBody,
    HeatCoupling,
    HeatIntegrals,
    Integrals,
    LoadColumn,
    MovingBody,
    Separated,
    StressStiffness,
)
from sparsemor.core.protocols.sparse_solver import (
    PROBLEM_FEATURES,
    Columns,
    Group,
    Recovery,
    Selection,
    SparseOutcome,
    SparseProblem,
    SparseSolver,
    SparseStart,
)
from sparsemor.core.protocols.step_amplitude import StepAmplitude, StepFunction, Stepping, Substep
from sparsemor.core.protocols.step_solver import (
    AroundSteps,
    ManySteps,
    ResultantSource,
    StepBlock,
    StepMemory,
    StepSolver,
)
from sparsemor.core.protocols.term import (
    LawArrays,
    LocalCopy,
    PointArrays,
    ReducedTerm,
    ResidualTerm,
    Term,
    Trial,
)

__all__ = [
    "Amplitude", "AroundSteps", "AssembledModel", "Basis", "Block", "BlockBases", "BlockBudget",
    "BlockData", "BlockLinearSolvers", "Body", "BodyFrame", "BodyPlugin", "BodyRecord", "BodyShape",
    "BodySize", "Choice", "Columns", "Connector", "ConnectorPlugin", "ConstraintRecord", "Contact",
    "ContactPlugin", "Dictionary", "Differentiable", "DofLocations", "Effect", "ElasticIntegrals",
    "ElasticLocal", "ElasticOperators", "Equations", "ErrorAction", "ErrorEstimator", "ErrorLimit",
    "Factorized", "FieldKind", "ForceLaw", "Frame", "FrameArrays", "FrameHistory", "FrameItem",
    "FrameRecord", "FrameWork", "FrictionLaw", "Function", "Group", "HeatBody", "HeatCoupling",
    "HeatIntegrals", "Held", "Integrals", "Integrator", "Joint", "JointPlugin", "LawArrays",
    "Layout", "LinearOutcome", "LinearSolver", "Load", "LoadColumn", "LoadPlugin", "LoadTable",
    "LocalCopy", "LocalRecord", "ManySteps", "Material", "MaterialProperties", "MatrixRecord",
    "MeanTemperature", "Mesh", "MeshPlugin", "MeshSize", "MovingBody", "NextStep", "NormalLaw",
    "OfflineProducts", "Origin", "Part", "Plugin", "PointArrays", "Preconditioner", "Prescribed",
    "ProbePlace", "PROBLEM_FEATURES", "Quantity", "RecordedForce", "Recording", "Records",
    "Recovery", "ReducedProblem", "ReducedTerm", "Reducer", "ResidualTerm", "ResultantSource",
    "RowsKept", "Sampler", "Selection", "Separated", "Solve", "SparseOutcome", "SparseProblem",
    "SparseSolver", "SparseStart", "Stage", "State", "StepAmplitude", "StepBlock", "StepFactors",
    "StepFormula", "StepFunction", "StepMemory", "StepOutcome", "Stepping", "StepSolver",
    "StressConstants", "StressRecovery", "StressStiffness", "Substep", "SurfaceLoads", "Table",
    "Tabled", "TabledAlong", "TableRecord", "TemperatureProperty", "Term", "TimeFunction", "Trial",
    "TrialRun", "UpdateRule", "UpdateRules", "VectorRecord",
]
