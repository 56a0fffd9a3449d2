"""Where simulation and measurement disagree, what is missing, and what is left once it is added (missing_effect.md)."""

from physreal_core.gap.adding import add_effect
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.looking import find_disagreement
from physreal_core.gap.report import Added, GapReport, ProposedMotion, Separation
from physreal_core.gap.search import Search, find_gap
from physreal_core.gap.settings import GapSettings

__all__ = [
    "Added",
    "Experiment",
    "GapReport",
    "GapSettings",
    "Interaction",
    "ProposedMotion",
    "Search",
    "Separation",
    "Trial",
    "add_effect",
    "find_disagreement",
    "find_gap",
]
