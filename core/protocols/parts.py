"""What the entries of a scene build: bodies, meshes, joints, contacts and loads."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Block, Layout
from sparsemor.core.mesh import Mesh
from sparsemor.core.notes import Note
from sparsemor.core.protocols.terms import Term

if TYPE_CHECKING:
    from sparsemor.core.stage import FrameHistory


class Part(Protocol):
    """A built body, joint or load: the numbers behind one entry of the scene."""

    @property
    def name(self) -> str: ...
    def blocks(self) -> Sequence[Block]: ...
    def terms(self, layout: Layout, parts: Mapping[str, "Part"]) -> Sequence[Term]: ...


class BodyPart(Part, Protocol):
    """A built body: what the assembly of a model asks of it.

    initial: block name -> (x, v) at the start; geometry: reducible block name -> node coordinates
    (n, d), m, and component (n,) of its unknowns; claims: whether `mechanics` or `heat_equations`
    accounts for a term; these return the body's separated equations (`core.separable`), or None.

    Optional: `probe(name, at)` for probes; `shape()` -> `core.run_header.BodyShape` for pictures;
    `guided(motion)`, `surface_loads(...)`, `pose`, `moves` and `idle` for scenes in two stages.
    """

    def initial(self) -> Mapping[str, tuple[FloatArray, FloatArray]]: ...
    def geometry(self) -> Mapping[str, tuple[FloatArray, IntArray]]: ...
    def claims(self, layout: Layout, term: Term) -> bool: ...
    def mechanics(self, layout: Layout, terms: Sequence[Term]) -> Any: ...
    def heat_equations(self, layout: Layout, terms: Sequence[Term]) -> Any: ...


@runtime_checkable
class NotedPart(Protocol):
    """A built part that warns of what is legal and most likely a mistake."""

    @property
    def notes(self) -> tuple[Note, ...]: ...


@runtime_checkable
class ReportsPassage(Protocol):
    """A built contact that knows when its surfaces pass each other in too few steps."""

    def passage(self, motion: Mapping[str, "FrameHistory"]) -> str:
        """A warning by the motion of each body at all steps, "" where there is none."""
        ...


@runtime_checkable
class NamesMultipliers(Protocol):
    """A built joint that says what each of its multipliers is."""

    @property
    def components(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each multiplier, such as ("force x", "N")."""
        ...


@runtime_checkable
class ProbedBody(Protocol):
    """A built body with material points: at is the name of a set, or body coordinates, m."""

    def probe(self, name: str, at: str | Sequence[float]) -> Any: ...


class BodyPlugin(Protocol):
    """A body of the scene: `build` returns a `BodyPart`. base: folder of the scene file, for
    relative paths.

    Optional: `expected()` -> a `core.mesh.BodySize`, or None where it cannot be known; a run that
    would not fit in memory is then refused before anything is meshed.
    """

    def build(self, name: str, base: Path) -> Part: ...


class MeshPlugin(Protocol):
    """A mesh of a body. Optional: `expected()` -> a `core.mesh.MeshSize`, before it is built."""

    def build(self, base: Path) -> Mesh: ...


class ConnectorPlugin(Protocol):
    """A joint, contact or load of the scene, built once the bodies stand.

    InputError keys are relative to its own entry in the scene (`between`, `on`). A class attribute
    `acts_on = "thermal"` says that the motion does not depend on it: a rigid stage leaves it out.
    """

    def build(self, name: str, parts: Mapping[str, Part]) -> Part: ...
