"""How far from its start a term is tried."""

import numpy as np

from sparsemor.core import Term
from sparsemor.core.model.model import Model


def scales(model: Model, term: Term) -> tuple[float, ...]:
    """Temperatures stay above 0 K; displacements are small, then as large as the body; quaternions
    leave the unit sphere."""
    first = model.layout.first
    thermal = len(term.rows) > 0 and bool(np.all((term.rows >= first.start)
                                                 & (term.rows < first.stop)))
    return (10.0,) if thermal else (1e-3, 1.0)
