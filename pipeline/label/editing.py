"""The clicks of one open page: what is drawn, what can be undone, what is not saved yet."""

from dataclasses import dataclass, field

from pipeline.clicks import Clicks, Place
from pipeline.products.masks import ROLES, Role


@dataclass
class Editing:
    """Clicks by frame and thing, on top of those that are saved.

    Attributes:
        saved: what capture.json says.
        edits: what was changed since, by place; empty clicks remove.
    """

    saved: dict[Place, Clicks] = field(default_factory=dict)
    edits: dict[Place, Clicks] = field(default_factory=dict)
    _before: list[tuple[Place, Clicks]] = field(default_factory=list)

    def at(self, t: int, role: Role) -> Clicks:
        """All clicks about a thing in a frame."""
        return self.edits.get((t, role), self.saved.get((t, role), Clicks()))

    def add(self, t: int, role: Role, point: tuple[float, float], label: int) -> None:
        """A click: 1 on the thing, 0 off it."""
        self._change((t, role), self.at(t, role).with_point(point, label))

    def clear(self, t: int) -> None:
        """No clicks in a frame any more."""
        for role in ROLES:
            if not self.at(t, role).empty:
                self._change((t, role), Clicks())

    def undo(self) -> int | None:
        """Take the last change back, and give its frame; None where there is none."""
        if not self._before:
            return None
        place, clicks = self._before.pop()
        self._put(place, clicks)
        return place[0]

    def frames(self) -> list[int]:
        """Those with clicks, in order."""
        places = self.saved | self.edits
        return sorted({t for (t, _), clicks in places.items() if not clicks.empty})

    def done(self, saved: dict[Place, Clicks], written: dict[Place, Clicks]) -> None:
        """Some edits are written, and capture.json says this now."""
        self.saved = saved
        self.edits = {place: clicks for place, clicks in self.edits.items() if written.get(place) != clicks}

    def _change(self, place: Place, clicks: Clicks) -> None:
        self._before.append((place, self.at(*place)))
        self._put(place, clicks)

    def _put(self, place: Place, clicks: Clicks) -> None:
        if clicks == self.saved.get(place, Clicks()):
            self.edits.pop(place, None)
        else:
            self.edits[place] = clicks
