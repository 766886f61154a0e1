"""What `validate` prints of bodies: masses and first frequencies of beams."""

from pathlib import Path

import numpy as np
import pytest

from small_scenes import tiny
from sparsemor import load
from sparsemor.core.simulation.validation import checked_model
from sparsemor.plugins.commands.body_summary import body_facts, in_words

CANTILEVER = Path(__file__).parents[3] / "docs" / "examples" / "cantilever.yaml"


@pytest.mark.parametrize("divisions", [[20, 2], [10, 2]])
def test_a_cantilever_has_the_mass_and_the_frequencies_of_a_beam(divisions: list[int]) -> None:
    """f = (1.8751 / L)^2 / (2 pi) (E I / (rho A))^(1/2); shear lowers it. Sparse and dense."""
    scene = load(CANTILEVER, {"bodies.beam.mesh.divisions": divisions})
    beam = body_facts(checked_model(scene), scene.bodies)["beam"]
    assert beam.mass == pytest.approx(1000 * 1.0 * 0.1 * 0.03, rel=1e-12)
    bent = 1.8751**2 / (2.0 * np.pi) * np.sqrt(7.0e10 * 0.1**2 / 12.0 / 1000.0)
    assert 0.98 * bent < beam.frequencies[0] < bent
    assert list(beam.frequencies) == sorted(beam.frequencies) and len(beam.frequencies) == 3
    assert (beam.nodes, beam.sets["left"]) == ((2 * divisions[0] + 1) * 5, 5)
    assert beam.unknowns == {"elastic": 2 * (beam.nodes - 5)}


def test_a_body_without_elastic_field_has_no_frequencies() -> None:
    scene = tiny().using({"bodies.bar.fields": ["thermal"], "bodies.bar.reference": None})
    found = body_facts(checked_model(scene), scene.bodies)
    assert found["bar"].frequencies == () and set(found["bar"].unknowns) == {"rigid", "thermal"}
    assert found["bar"].mass is not None
    row = in_words(found).splitlines()[2]
    assert row.split()[0] == "bar" and row.endswith("-")
