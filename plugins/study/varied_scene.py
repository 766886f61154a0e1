"""Scene that a study of any scene varies: its blocks, its times, and the plugins that fit it."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

from sparsemor.core.errors import InputError
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.core.model.model import Model
from sparsemor.core.registry.registry import Registry
from sparsemor.core.scene.scene import Scene, build
from sparsemor.core.scene.source import Source
from sparsemor.core.simulation.validation import checked_model

USUAL = 30
"""Atoms of a block whose number the scene does not set."""
SHARES = (0.25, 0.4, 0.6, 0.8, 1.0)
"""Numbers of atoms of a study, relative to those of the scene."""


@dataclass(frozen=True, eq=False)
class Subject:
    """A scene, assembled, as the functions of studies of any scene receive it."""

    scene: Scene
    model: Model

    @classmethod
    def from_source(cls, source: Source) -> "Subject":
        """The scene of a source. Raises `LocatedError` with the faults of the scene."""
        scene = build(source)
        try:
            return cls(scene, checked_model(scene))
        except InputError as error:
            raise source.locate(error.faults) from None

    @property
    def registry(self) -> Registry:
        return self.scene.source.registry

    @cached_property
    def blocks(self) -> dict[str, int]:
        """Reducible block -> number of its unknowns. Raises InputError if there is none."""
        layout = self.model.layout
        found = {n: layout[n].stop - layout[n].start for n in self.model.reducible()}
        if not found:
            raise InputError(
                f"{self.scene.name} has no displacements or temperatures to reduce, only rigid "
                "bodies: of the studies of any scene only `integrators` applies to it")
        return found

    @property
    def trains_elsewhere(self) -> bool:
        """True if the training run has other loads or parameters than the run."""
        training = self.scene.training
        return bool(training.overrides) or training.several

    @property
    def training_end(self) -> float:
        """End of a training run, s, that leaves a part of the run outside it: that of the scene, or
        half of the run where the scene trains on all of it."""
        time, end = self.scene.time, self.scene.training_end
        if self.trains_elsewhere or end < time.end - 0.5 * time.step:
            return end
        return float(f"{max(1, round(0.5 * time.end / time.step)) * time.step:.12g}")

    def outside_training(self) -> dict[str, Any]:
        """Keys of a study whose errors are those outside training."""
        if self.trains_elsewhere:
            return {}
        end = self.training_end
        return {"set": {"training.end": end}, "errors_from": end}

    @cached_property
    def reducer(self) -> dict[str, Any]:
        """Options of the scene's reducer as written, with its name under `use`."""
        written = self.scene.source.tree.get("reducer")
        if isinstance(written, Mapping) and isinstance(written.get("use"), str):
            return dict(written)
        return {"use": self.scene.reducer_name} if isinstance(written, str) else dict(
            self.scene.dump()["reducer"])

    def own(self, name: str) -> dict[str, Any]:
        """Reducer `name` for all atoms of a basis: with the options that the scene gives it,
        without its bases and its numbers of active atoms."""
        if self.reducer["use"] != name:
            return {"use": name}
        kept = {k: v for k, v in self.reducer.items() if k not in ("basis", "bases")}
        if "budgets" in kept:
            kept["budgets"] = {n: {k: v for k, v in b.items() if k != "atoms"}
                               for n, b in kept["budgets"].items()}
        return kept

    @cached_property
    def pods(self) -> dict[str, dict[str, Any]]:
        """Block -> POD basis: that of the scene, of a limited number of atoms."""
        chosen = self.scene.reducer.trial_bases()
        found = {}
        for name, size in self.blocks.items():
            own: dict[str, Any] = {"use": "pod"}
            if chosen is not None:
                basis = matched_option(name, dict(chosen.others), chosen.shared)
                if self.registry.name_of("basis", type(basis)) == "pod":
                    own |= basis.model_dump(include={"weights", "count"}, exclude_defaults=True)
            # USUAL: number of atoms where the scene sets none
            found[name] = own | {"count": min(own.get("count") or USUAL, size)}
        return found

    @property
    def atoms(self) -> int:
        """Largest number of atoms of a block."""
        return max(int(b["count"]) for b in self.pods.values())

    def ladder(self) -> list[int]:
        """Increasing numbers of atoms of the largest block, up to that of the scene."""
        return sorted({max(1, math.ceil(s * self.atoms - 1e-9)) for s in SHARES})

    def count(self, name: str, atoms: int) -> int:
        """Atoms of a block, in proportion to the `atoms` of the largest one."""
        return max(1, math.ceil(int(self.pods[name]["count"]) * atoms / self.atoms - 1e-9))

    def bases(self, atoms: int, of: Callable[[str], Mapping[str, Any]] | None = None
              ) -> dict[str, Any]:
        """Changes of a scene: a basis in each block with numbers of atoms in proportion to `atoms`;
        POD bases unless `of` returns others by block."""
        made = {n: {**(of or self.pods.__getitem__)(n), "count": self.count(n, atoms)}
                for n in self.blocks}
        first = next(n for n, b in self.pods.items() if b["count"] == self.atoms)
        others = {n: b for n, b in made.items() if b != made[first]}
        return {"reducer.basis": made[first], "reducer.bases": self.by_field(others, made)}

    def by_field(self, some: Mapping[str, Any], every: Mapping[str, Any]) -> dict[str, Any]:
        """Options of blocks by patterns `*.field` where all blocks of a field have the same."""
        found: dict[str, Any] = {}
        for name, value in some.items():
            field = name.rpartition(".")[2]
            like = [v for n, v in every.items() if n.rpartition(".")[2] == field]
            found[f"*.{field}" if all(v == value for v in like) else name] = value
        return found

    def budgets(self, make: Callable[[str], Mapping[str, Any]]) -> dict[str, Any]:
        """Budgets of all blocks, by pattern."""
        made = {n: dict(make(n)) for n in self.blocks}
        return self.by_field(made, made)

    def installed(self, kind: str) -> Iterator[tuple[str, Any]]:
        """Names and classes of the plugins of a kind that can be used without options."""
        for plugin in self.registry.names(kind):
            name = self.registry.spelling(plugin)
            try:
                cls: Any = self.registry.get(kind, name)
                cls.model_validate({}, context={"registry": self.registry})
            except (InputError, ValueError):  # broken, or one that needs options
                continue
            yield name, cls


AnyScene: TypeAlias = Callable[[Subject], Mapping[str, Any]]
"""Study of any scene: function of a scene that returns the contents of a study file without
`scene`."""
