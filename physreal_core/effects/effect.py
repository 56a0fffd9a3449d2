"""What a candidate effect is: a dormant term of the simulation, or of the observation, with named coefficients in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.errors import InputError
from physreal_core.simulation import Body, Clamp, Grip, Parameters, SimulationConfig, States, Tool
from physreal_core.simulation.body_terms import absent_terms

Family = Literal["around", "material", "mass", "contact", "grip", "measurement"]
Values = Mapping[str, Tensor]
"""Coefficients of one effect by name; each is a tensor of shape []."""
ANYWHERE = 100.0
"""Bound of coordinates that may be any [m]."""


@dataclass(frozen=True)
class Coefficient:
    """One number of an effect.

    Args:
        name: within its effect.
        unit: SI, as in "N s/m"; "1" for none.
        meaning: in words.
        dormant: the value of an amplitude at which the effect is absent; for a shape, where it starts.
        lower, upper: bounds of a fit.
        scale: size of a plainly visible effect; the step of its tangent and the width of its prior.
        kind: an `amplitude` switches the effect on; a `shape` (a place, a direction, an onset) means nothing without
            one.
    """

    name: str
    unit: str
    meaning: str
    dormant: float
    lower: float
    upper: float
    scale: float
    kind: Literal["amplitude", "shape"] = "amplitude"


@dataclass(frozen=True)
class Setting:
    """What an effect may look at beside its coefficients; nothing here is differentiated.

    Args:
        body, grip, clamps: the simulator's.
        fps: frames per second.
        gravity: [m/s2].
        ground_height: z of the support plane [m], None without one.
        controllers: measured controller points [m], shape [T, C, 3].
        T_world_camera: pose of the camera, shape [4, 4]; None for motion capture.
        hand_seen: whether the controller points were seen by that camera too; a robot's own record is not.
        tool: the simulator's.
        far_side_guessed: whether the shape of what the camera did not see was made up.
    """

    body: Body
    grip: Grip | None
    clamps: tuple[Clamp, ...]
    fps: float
    gravity: tuple[float, float, float]
    ground_height: float | None
    controllers: Float[Tensor, "frames controllers 3"]
    T_world_camera: Float[Array, "4 4"] | None = None
    hand_seen: bool = True
    tool: Tool | None = None
    far_side_guessed: bool = False

    @property
    def hand_acts(self) -> bool:
        """Whether the controller points move the body: by holding it, or by pushing."""
        return self.grip is not None or self.tool is not None

    @property
    def all_seen(self) -> bool:
        """Whether one camera has seen both the body and the controller."""
        return self.T_world_camera is not None and self.hand_seen


@dataclass(frozen=True)
class Inputs:
    """Everything of a rollout that an effect may change; differentiable.

    Args:
        parameters: of the rollout, per particle.
        controllers: controller points [m] at frame times, and at the next one, shape [T + 1, C, 3].
    """

    parameters: Parameters
    controllers: Float[Tensor, "places controllers 3"]

    @property
    def frames(self) -> int:
        """T, how many frames they are for."""
        return len(self.controllers) - 1


Limits = Mapping[str, tuple[float, float]]
"""Lowest and highest value of coefficients, by name, in SI units."""


class Effect:
    """One candidate: subclasses fill in the class variables and override `act` or, for the measurement, `observe`.

    Attributes:
        name: key in the registry, e.g. "linear_drag".
        family: where it belongs.
        words: what happens, in one sentence.
        formula: the force or law, in plain text.
        shows: where in space and time it shows.
        distinguished_by: the motion that shows it best, and distinguishes it from similar effects.
        coefficients: in the order in which they are reported.
        terms: of `SimulationConfig.terms`, those that `act` fills.
        volume_terms: further ones for a volume, which a thin body does without: its deformation follows from its vertices.
        laws: fields of `SimulationConfig` that it replaces, e.g. {"plastic_law": "von_mises"}.
        same_as: number of the model that it only changes: where that is not known, it cannot be told from the effect.
    """

    name: ClassVar[str]
    family: ClassVar[Family]
    words: ClassVar[str]
    formula: ClassVar[str]
    shows: ClassVar[str]
    distinguished_by: ClassVar[str]
    coefficients: ClassVar[tuple[Coefficient, ...]]
    terms: ClassVar[tuple[str, ...]] = ()
    volume_terms: ClassVar[tuple[str, ...]] = ()
    laws: ClassVar[dict[str, str]] = {}
    same_as: ClassVar[str | None] = None

    @property
    def units(self) -> dict[str, str]:
        """Of the coefficients, by name."""
        return {coefficient.name: coefficient.unit for coefficient in self.coefficients}

    @property
    def dormant(self) -> dict[str, float]:
        """Of all coefficients, by name and in SI units, the values at which the effect is absent; shapes where they start."""
        return {coefficient.name: coefficient.dormant for coefficient in self.coefficients}

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        """The rollout's inputs with the effect in them. Several effects act one after another, so what is there is added to."""
        return inputs

    def observe(self, points: Float[Tensor, "frames points 3"], values: Values, setting: Setting) -> Tensor:
        """Where the measurement would see points [m] that truly are at `points`."""
        return points

    def frames_needed(self, frames: int, values: Mapping[str, float]) -> int:
        """Frames of the points that `observe` has to be given, so that the first `frames` of what it gives lie within them."""
        return frames

    def carried(
        self, values: Mapping[str, float], rotation: Float[Array, "3 3"], translation: Float[Array, "3"]
    ) -> dict[str, float]:
        """The values for the same object in another place: what was at x [m] is now at R x + t.

        An effect that belongs to a place or a direction in the body overrides this.
        """
        return dict(values)

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Values from which a search may begin, one dict per start; what is not named is dormant.

        A start fixes the shapes (several places, several directions), and for an effect that has a threshold the
        amplitude at which it just acts; any other amplitude is stepped by its scale.

        Args:
            setting: of the capture.
            motion: the baseline's rollout, shapes [T, N, ...], for effects that have to look where the body goes.
        """
        return ({},)

    def limits(self, setting: Setting) -> Limits:
        """Of coefficients that this body bounds more narrowly than `coefficients` do: a place that lies in it."""
        return {}

    def large_starts(self, setting: Setting) -> tuple[dict[str, float], ...]:
        """Amplitudes from which a fit starts too, each at the modulus that suits it.

        They are plainly visible sizes of an effect that a modulus can imitate, or sizes that the body shows at frame 0.
        A baseline without the effect then lies in another minimum, from which tangents do not lead to the effect.
        """
        return ()

    def blocking_starts(
        self, setting: Setting, seen: Float[Array, "points 3"], expected: Float[Array, "points 3"]
    ) -> tuple[dict[str, float], ...]:
        """Values from which a fit starts too, which keep the body from where it was not seen.

        The baseline takes it there. One amplitude is of plainly visible size. Nothing is blocked where the body was
        seen.

        Args:
            setting: of the capture.
            seen: where tracked points were measured in the training frames [m].
            expected: where the baseline has them then [m].
        """
        return ()

    def replacement_starts(
        self, setting: Setting, other: "Effect", values: Mapping[str, float], motion: States | None
    ) -> tuple[dict[str, float], ...]:
        """Values from which a fit starts where another effect of the same term may be mistaken for this one.

        Args:
            setting: of the capture.
            other: the effect that was found.
            values: its coefficients, in SI units.
            motion: with it in place, shapes [T, N, ...].
        """
        return ()


def fits(effect: Effect, config: SimulationConfig) -> bool:
    """Whether the laws that an effect needs are free in this configuration: the identity, or its own already."""
    return all(getattr(config, key) in ("identity", law) for key, law in effect.laws.items())


def lacking(effect: Effect, body: Body) -> str:
    """Why an effect does not act on a body, in words; empty where it does."""
    kind = "a volume" if body.elements is None else "a thin body"
    if terms := [term for term in effect.terms if term in absent_terms(body)]:
        return f"{kind} has no {' and no '.join(term.replace('_', ' ') for term in terms)}"
    return f"{kind} does not flow" if body.elements is not None and "plastic_law" in effect.laws else ""


def configured(config: SimulationConfig, effects: tuple[Effect, ...], body: Body | None = None) -> SimulationConfig:
    """The configuration with the terms and laws that these effects need.

    Args:
        config: without them.
        effects: which.
        body: on which they act; None for a volume.

    Raises:
        InputError: an effect needs a law where the configuration has another one.
    """
    for effect in effects:
        if not fits(effect, config):
            raise InputError(
                f"the effect {effect.name!r} needs {effect.laws}",
                where="SimulationConfig",
                expected="the identity there, which the effect replaces",
                remedy="leave the effect out for this material",
            )
    volume = body is None or body.elements is None
    needed = (term for effect in effects for term in (*effect.terms, *(effect.volume_terms if volume else ())))
    terms = tuple(sorted({*config.terms, *needed}))
    laws = {key: law for effect in effects for key, law in effect.laws.items()}
    return replace(config, terms=terms, **laws)
