"""A case: a body, a goal, what the planner is told of it, and a seed; and the manners in which each is planned for and executed."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.planning.scenes import SETTINGS, Setting
from physreal_core.errors import InputError

KINDS = {"points": "100 points to places", "shape": "a shape", "mask": "a mask in the camera"}
"""What the planner is told of a goal, in words."""


@dataclass(frozen=True)
class Manner:
    """How a case is planned for and executed.

    Args:
        words: for the page.
        every: frames between plans; None: the first plan is followed to its end.
        refined: whether the gradient refines what the search has found.
    """

    words: str
    every: int | None = None
    refined: bool = True


MANNERS = {
    "once": Manner("planned once"),
    "drawn": Manner("planned once, by drawing alone", refined=False),
    "anew": Manner("planned anew every 12 frames", every=12),
}


HIDDEN = "hidden"
"""In place of a manner: no plan, but the way that the goal was made with."""


@dataclass(frozen=True)
class Case:
    """One goal for one body.

    Args:
        body: of `SETTINGS`.
        goal: of its goals.
        kind: of `KINDS`.
        seed: of the hidden way (`Setting.way`), of the search and of the noise.
    """

    body: str
    goal: str
    kind: str
    seed: int

    @classmethod
    def of(cls, text: str) -> Case:
        """`body:goal:kind`, with underscores for a goal's spaces, and `:seed` where it is not 0.

        Raises:
            InputError: there is no such case.
        """
        body, goal, kind, seed = (*text.split(":"), "0")[:4] if text.count(":") in (2, 3) else ("", "", "", "")
        goal = goal.replace("_", " ")
        if body not in SETTINGS or goal not in SETTINGS[body].goals or kind not in KINDS or not seed.isdigit():
            known = [f"{body}:{goal.replace(' ', '_')}" for body, own in SETTINGS.items() for goal in own.goals]
            raise InputError(
                f"no case {text!r}",
                where="benchmarks.planning",
                expected=f"one of {', '.join(known)}, then one of {', '.join(KINDS)}, then a seed, with colons between",
            )
        return cls(body, goal, kind, int(seed))

    @property
    def setting(self) -> Setting:
        """Of the body."""
        return SETTINGS[self.body]

    @property
    def task(self) -> str:
        """Body, goal and kind, as they are given."""
        return f"{self.body}:{self.goal.replace(' ', '_')}:{self.kind}"

    @property
    def name(self) -> str:
        """For files."""
        return f"{self.task.replace(':', '-')}-{self.seed}"
