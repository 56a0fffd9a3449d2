"""The one exception that a user's input can raise, with what was wrong, where, what was expected and what to change."""


class InputError(ValueError):
    """Input that cannot be used, said so that its owner can mend it.

    Args:
        what: what was found, with the offending value.
        where: sequence, stage, file, frame or key, as precisely as it is known.
        expected: what would have been right, with its unit.
        remedy: which file or key to change.
    """

    def __init__(self, what: str, *, where: str = "", expected: str = "", remedy: str = "") -> None:
        self.what, self.where, self.expected, self.remedy = what, where, expected, remedy
        parts = [f"{where}: {what}" if where else what]
        if expected:
            parts.append(f"expected {expected}")
        if remedy:
            parts.append(f"to mend it, {remedy}")
        super().__init__("; ".join(parts))


class SimulationError(RuntimeError):
    """A rollout that cannot go on (non-finite state, too many substeps); carries frame, substep and particle."""

    def __init__(self, what: str, *, frame: int, substep: int, particle: int) -> None:
        self.what, self.frame, self.substep, self.particle = what, frame, substep, particle
        super().__init__(f"{what} (frame {frame}, substep {substep}, particle {particle})")
