"""Law kit of a basis."""

from dataclasses import replace
from functools import partial

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.basis import Basis, BlockData, Dictionary
from sparsemor.core.testing.random_inputs import (
    ANY,
    DISPLACEMENTS,
    TEMPERATURES,
    copied,
    keeps_contract,
    law,
    random_block,
    random_heat,
    refused,
    unchanged,
)


def check_basis(basis: Basis, seed: int = 0, trials: int = 20) -> None:
    """Laws of a basis (computes the dictionary of a block): well-formed dictionaries, equal ones
    for equal data, and the energy share that they report.

    Displacements coupled to temperatures, temperatures (insulated ones too) and a block of neither
    kind are tried in turn. A basis that needs snapshots must raise InputError for none, zero and
    non-finite ones. If `info` gives an "energy", the atoms must recover that share of the
    snapshots.
    """
    keeps_contract("basis", basis)
    for trial in range(trials):
        rng = np.random.default_rng([seed, trial])
        kind = (ANY, DISPLACEMENTS, TEMPERATURES)[trial % 3]
        block = random_heat(rng) if kind is TEMPERATURES else random_block(rng, kind)
        before = copied(block)
        dictionary = basis.build(block)
        where = f"({kind.name}, seed {seed}, trial {trial})"
        law(unchanged(block, before), f"the basis wrote to its argument {where}")
        _well_formed(dictionary, block.size, where)
        again = basis.build(block)
        law(np.array_equal(again.atoms, dictionary.atoms)
            and np.array_equal(again.offset, dictionary.offset),
            f"two builds from equal data differ {where}")
        if basis.needs_snapshots:
            _holds_its_energy(dictionary, block.snapshots, where)
    if basis.needs_snapshots:
        _refuses_bad_snapshots(basis, random_block(np.random.default_rng(seed)))


def _well_formed(dictionary: Dictionary, n: int, where: str) -> None:
    """Checks shapes and types of a dictionary: unit columns, finite, each with a provenance of its
    own."""
    atoms, offset = dictionary.atoms, dictionary.offset
    law(atoms.ndim == 2 and atoms.shape[0] == n and atoms.shape[1] > 0,
        f"atoms have shape {atoms.shape}, not ({n}, k) with k > 0 {where}")
    law(offset.shape == (n,), f"offset has shape {offset.shape}, not ({n},) {where}")
    law(atoms.dtype == np.float64 and offset.dtype == np.float64,
        f"atoms and offset must be float64, not {atoms.dtype} and {offset.dtype} {where}")
    law(np.isfinite(atoms).all() and np.isfinite(offset).all(),
        f"atoms or offset hold values that are not finite {where}")
    off = float(np.abs(np.linalg.norm(atoms, axis=0) - 1.0).max())
    law(off < 1e-10, f"atoms must be unit columns: a norm has an error of {off:.1e} {where}")
    law(len(dictionary.provenance) == atoms.shape[1],
        f"{len(dictionary.provenance)} provenances for {atoms.shape[1]} atoms {where}")
    law(len(set(dictionary.provenance)) == len(dictionary.provenance),
        f"two atoms have the same provenance {where}")
    law(all(isinstance(v, int | float | str) for v in dictionary.info.values()),
        f"info may hold numbers and strings only {where}")


def _holds_its_energy(dictionary: Dictionary, snapshots: FloatArray, where: str) -> None:
    """Checks that projection on the atoms loses no more of the snapshots than the reported energy
    allows."""
    energy = dictionary.info.get("energy")
    if not isinstance(energy, int | float):
        return
    deviation = snapshots - dictionary.offset[:, None]
    c = np.linalg.lstsq(dictionary.atoms, deviation, rcond=None)[0]
    lost = float(np.linalg.norm(deviation - dictionary.atoms @ c))
    allowed = float(np.sqrt(max(0.0, 1.0 - energy)) + 1e-7) * float(np.linalg.norm(deviation))
    law(lost <= allowed,
        f"decoding the encoded snapshots loses {lost:.2e} of their norm, but the reported energy "
        f"{energy!r} allows {allowed:.2e} {where}")


def _refuses_bad_snapshots(basis: Basis, block: BlockData) -> None:
    bad = block.snapshots.copy()
    bad[0, 0] = np.nan
    cases = {
        "no snapshots": block.snapshots[:, :0],
        "snapshots of zeros": np.zeros_like(block.snapshots),
        "snapshots with nan": bad,
    }
    for name, snapshots in cases.items():
        refused(name, partial(basis.build, replace(block, snapshots=snapshots)))
