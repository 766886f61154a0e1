"""Classes of core of which kept reduced models are made (`Plugin.stored_classes`)."""

from collections.abc import Sequence

from sparsemor.core.model.compressed_local import CompressedLocal
from sparsemor.core.notes import Level, Note
from sparsemor.core.protocols.basis import Dictionary
from sparsemor.core.protocols.body import BodyShape, ProbePlace, ProbeStress, StressConstants
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.layout import Block, FieldKind, Layout, Quantity
from sparsemor.core.protocols.load_tables import Table
from sparsemor.core.protocols.prescribed_motion import FrameHistory, Stage
from sparsemor.core.protocols.separable import LoadColumn, MovingBody, Separated
from sparsemor.core.protocols.step_amplitude import StepAmplitude, StepFunction
from sparsemor.core.protocols.time_function import Held, Prescribed
from sparsemor.core.results.metadata import ProbeHeader, RunHeader
from sparsemor.core.results.probes import AffineOutput, ForceReader, ProbeReader
from sparsemor.core.simulation.blow_up import Extent, Extents

CLASSES: Sequence[object] = (
    AffineOutput, Block, BodyShape, CompressedLocal, Dictionary, Extent, Extents, FieldKind,
    ForceReader, FrameHistory, Held, Layout, Level, LoadColumn, MovingBody, Note, Prescribed,
    ProbeHeader, ProbePlace, ProbeReader, ProbeStress, Quantity, RunHeader, Separated, Stage,
    State, StepAmplitude, StepFunction, StressConstants, Table,
)
