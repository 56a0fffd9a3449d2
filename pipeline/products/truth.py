"""What is known of a capture by construction or by annotation; for scores alone, never for a fit."""

from dataclasses import dataclass
from typing import ClassVar

from physreal_core.array_types import Array, Bool, Float, Int
from pipeline.products._files import ArrayFile


@dataclass(frozen=True)
class CaptureTruth(ArrayFile):
    """truth.npz of a capture; None is what its maker does not know. World frame; arrays keep their types.

    Attributes:
        youngs_modulus, poissons_ratio, density, friction_coefficient, damping: [Pa], 1, [kg/m3], 1, [s].
        moduli: [M] Pa, Young's moduli of the tetrahedra where they differ.
        rest_vertices: [V, 3] m, stress-free, where the object lay before it sank under its weight.
        tets: [M, 4] and faces: [F, 3], vertex indices.
        vertices: [T, V, 3] m.
        gripped: [B], vertices that the hand holds.
        hand: [T, 3] m, displacement of the hand since frame 0.
        hand_vertices: [H, 3] m at frame 0, and hand_faces: [G, 3].
        further_hands: [T, O, 3] m, surfaces of the hands beside the first in every frame, and
            further_hand_faces: [Q, 3].
        T_world_prior: [4, 4], takes shape_prior.glb (rotation, translation, scale) onto `rest_vertices`.
        geometry: of a thin body, "linear" (a rope) or "planar" (a cloth); its `vertices` are those of its closed skin.
        thickness: of a cloth, or the diameter of a rope [m].
        membrane_stiffness: of a cloth, E t [N/m].
        stretching_stiffness: of a rope, E A [N].
        bending_stiffness: D of a cloth [N m], or E I of a rope [N m^2].
        twisting_stiffness: of a rope, G J [N m^2].
        bending_poissons_ratio: of a cloth, beside `poissons_ratio`, which is that of its membrane.
        areal_density: of a cloth [kg/m^2]; mass_per_length: of a rope [kg/m].
        nominal_membrane_stiffness, nominal_stretching_stiffness, nominal_bending_stiffness, nominal_twisting_stiffness: what
            the simulator was given; those above are what its elements have, by measurement.
        middle_rest: [W, 3] m, nodes of the middle surface or the centre line, stress-free, in the world.
        middle_elements: [E, 3] or [E, 2], its triangles or segments.
        middle_vertices: [T, W, 3] m.
        middle_directors: [T, E, 3], of a rope's segments: unit vectors across them that turn with them.
        middle_gripped: [N], its nodes that the hand holds.
        fps: frames per second.
        effect_names: what is hidden in the recording.
        effect_values_json: its coefficients, effect → name → value, as JSON.
        strength: how strong it is, in a word.
        clean_tracks: [T, J, 3] m, the tracks without noise.
        clean_controllers: [T, C, 3] m, the hand's points without error.
        gt_track_3d: [T, A, 3] m, annotated points; NaN where not annotated.
        object_points: [T, P, 3] m, points that several cameras saw; NaN where not seen.
        object_visibilities, object_motions_valid: [T, P], seen, and tracked to the next frame.
        surface_points, interior_points: [S, 3] m, of the annotators' object at frame 0.
    """

    FILE = "truth.npz"
    REMEDY = "only captures made by the rig or imported with annotations have one"
    COMPRESSED = True
    KEYS: ClassVar[dict[str, str]] = {"youngs_modulus": "E", "poissons_ratio": "nu", "friction_coefficient": "friction"}

    youngs_modulus: float | None = None
    poissons_ratio: float | None = None
    density: float | None = None
    friction_coefficient: float | None = None
    damping: float | None = None
    moduli: Float[Array, " M"] | None = None
    rest_vertices: Float[Array, "V 3"] | None = None
    tets: Int[Array, "M 4"] | None = None
    faces: Int[Array, "F 3"] | None = None
    vertices: Float[Array, "_ V 3"] | None = None
    gripped: Int[Array, " B"] | None = None
    hand: Float[Array, "_ 3"] | None = None
    hand_vertices: Float[Array, "H 3"] | None = None
    hand_faces: Int[Array, "G 3"] | None = None
    further_hands: Float[Array, "_ O 3"] | None = None
    further_hand_faces: Int[Array, "Q 3"] | None = None
    T_world_prior: Float[Array, "4 4"] | None = None
    geometry: str | None = None
    thickness: float | None = None
    membrane_stiffness: float | None = None
    stretching_stiffness: float | None = None
    bending_stiffness: float | None = None
    twisting_stiffness: float | None = None
    bending_poissons_ratio: float | None = None
    areal_density: float | None = None
    mass_per_length: float | None = None
    nominal_membrane_stiffness: float | None = None
    nominal_stretching_stiffness: float | None = None
    nominal_bending_stiffness: float | None = None
    nominal_twisting_stiffness: float | None = None
    middle_rest: Float[Array, "W 3"] | None = None
    middle_elements: Int[Array, "E K"] | None = None
    middle_vertices: Float[Array, "_ W 3"] | None = None
    middle_directors: Float[Array, "_ E 3"] | None = None
    middle_gripped: Int[Array, " _"] | None = None
    fps: float | None = None
    effect_names: Array | None = None
    effect_values_json: str | None = None
    strength: str | None = None
    clean_tracks: Float[Array, "T J 3"] | None = None
    clean_controllers: Float[Array, "T C 3"] | None = None
    gt_track_3d: Float[Array, "_ A 3"] | None = None
    object_points: Float[Array, "_ P 3"] | None = None
    object_visibilities: Bool[Array, "_ P"] | None = None
    object_motions_valid: Bool[Array, "_ P"] | None = None
    surface_points: Float[Array, "_ 3"] | None = None
    interior_points: Float[Array, "_ 3"] | None = None

    @staticmethod
    def on_disk(array: Array) -> Array:
        """The array as it is."""
        return array
