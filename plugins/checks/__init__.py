"""Checks of runs: notes before the first step and after the last one."""

ORDER = (
    "units", "contacts", "selected_atoms", "alternating_joint_forces", "free_rotations",
    "undershoot", "spring_turns", "short_impacts", "unheld_bodies", "mixed_scales", "plausibility",
    "options", "few_atoms", "stress_stiffness", "estimated_error", "energy_lost", "time_error",
    "heat_balance", "stability", "trial_space", "error_action",
)
"""Order in which their notes are told."""


def place(name: str) -> int:
    """Place of a check in this order."""
    return ORDER.index(name)
