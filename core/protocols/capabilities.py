"""Tables of optional protocols of terms, step solvers and memories.

Core and reducers test for an optional protocol with `isinstance`; an object without its members
simply lacks the capability. The documentation prints these tables.
"""

from collections.abc import Mapping

from sparsemor.core.protocols import element_integrals, step_solver, term

OTHERS: Mapping[str, tuple[type, ...]] = {
    "term": (term.HasConstantMatrices, term.NamesSource, term.ChecksStep, term.ReportsResultants,
             term.TimeDependent, term.HasPoints,
             element_integrals.WeighsElements),
    "reduced term": (term.WrapsTerm, term.Linearizes, term.RelocatesNear, term.ChecksStep,
                     term.ReportsResultants, term.HasPointArrays),
    "step solver": (step_solver.RedrawsRows, step_solver.FreezesSupport,
                    step_solver.RespondsByBlock, step_solver.RespondsExactly,
                    step_solver.CountsLinearIterations, step_solver.ReportsTerms,
                    step_solver.SolvesManySteps, step_solver.LeavesMesh),
    "memory of a step solver": (step_solver.Restarts,),
}
"""Objects (terms, step solvers, ...) -> their optional protocols."""
