"""Tables of optional protocols: of plugins, of the objects that they build, and of terms, step
solvers and frames.

Core and reducers test for an optional protocol with `isinstance`; an object without its members
simply lacks the capability. The documentation and `sparsemor plugins NAME` print these tables.
"""

from collections.abc import Mapping

from sparsemor.core.protocols import (
    body,
    body_frame,
    contact,
    element_integrals,
    joint,
    layout,
    mesh,
    part,
    step_solver,
    term,
)

CAPABILITIES: Mapping[str, tuple[type, ...]] = {
    "body": (body.EstimatesSize, body.SelectsFields, layout.DeclaresFields),
    "contact": (contact.DeclaresSurfaces, contact.NamesSides),
    "joint": (part.DeclaresEffect,),
    "load": (part.DeclaresEffect,),
    "mesh": (mesh.EstimatesMeshSize,),
}
"""Kind of plugin -> optional protocols of the plugin class."""
_ANY_PART = (part.HasNotes,)
_CONNECTOR = (part.LocalizesRows, part.MovesOverBody, body.ChangesBodies, part.HasSurroundings,
              *_ANY_PART)
BUILT: Mapping[str, tuple[type, ...]] = {
    "body": (body.HasProbes, body.HasMesh, body.HasShape, body.CopiesRigidly, body.HasPose,
             body.FollowsMotion, body.CarriesSurfaceLoads, body.LimitsTemperature, *_ANY_PART),
    "contact": (contact.ImportsMotion, contact.ConductsHeat, contact.ReportsNoContact,
                contact.ReportsChatter, contact.ReportsPassage, *_CONNECTOR),
    "joint": (joint.NamesMultipliers, joint.HasForceLaw, joint.PrescribesReactions,
              joint.PassesReactionsOn, *_CONNECTOR),
    "load": _CONNECTOR,
}
"""Kind of plugin -> optional protocols of the object that its `build` returns."""

OTHERS: Mapping[str, tuple[type, ...]] = {
    "term": (term.HasConstantMatrices, term.NamesSource, term.ChecksStep, term.ReportsResultants,
             term.TimeDependent, part.HasSurroundings, term.HasPoints,
             element_integrals.WeighsElements),
    "reduced term": (term.WrapsTerm, term.Linearizes, term.RelocatesNear, term.ChecksStep,
                     term.ReportsResultants, term.HasPointArrays),
    "step solver": (step_solver.RedrawsRows, step_solver.FreezesSupport,
                    step_solver.RespondsByBlock, step_solver.RespondsExactly,
                    step_solver.CountsLinearIterations, step_solver.ReportsTerms,
                    step_solver.SolvesManySteps, step_solver.LeavesMesh),
    "memory of a step solver": (step_solver.Restarts,),
    "frame": (body_frame.EvaluatesManyTimes, body_frame.HasArrays),
    "material property": (body.HasNumbers,),
}
"""Other objects (terms, step solvers, frames, ...) -> their optional protocols."""
