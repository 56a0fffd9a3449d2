"""The methods by name."""

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.baselines import graph_network, one_material, ours, spring_mass
from benchmarks.baselines.scene import Fitted, Scene


@dataclass(frozen=True)
class Method:
    """One row of the tables.

    Args:
        fit: from a sequence and the seconds that it may take.
        words: what it is.
        part: whether it is ours with a part left out.
        video: whether it says something only where there are silhouettes.
        stages: of the project that have made it, if it is only read; their records say how long that took.
    """

    fit: Callable[[Scene, float], Fitted]
    words: str
    part: bool = False
    video: bool = False
    stages: tuple[str, ...] = ()


METHODS = {
    "ours": Method(ours.fit, "ours: Stages 1 and 2"),
    "with_effect": Method(
        ours.with_effect,
        "ours with the missing effect that the search named",
        stages=("fit_global", "fit_patches", "find_gap", "add_effect"),
    ),
    "spring_mass": Method(spring_mass.fit, "spring–mass: CMA-ES, then Adam for each spring (PhysTwin, Spring-Gaus)"),
    "one_material": Method(one_material.fit, "one material, the hand rigid (PAC-NeRF, PhysFlow)"),
    "graph_network": Method(graph_network.fit, "graph network trained on the sequence (GS-Dynamics)"),
    "without_patches": Method(ours.without_patches, "ours without patches (Stage 1)", part=True),
    "without_motion": Method(ours.without_motion, "ours without the motion loss", part=True, video=True),
    "without_masks": Method(ours.without_masks, "ours without the mask loss", part=True, video=True),
}
