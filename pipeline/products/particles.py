"""The object as material points, and what is bound to them: patches of the material, Gaussians, tracks, the grip."""

from dataclasses import dataclass

from physreal_core.array_types import Array, Float, Int
from physreal_core.errors import InputError
from pipeline.products._files import ArrayFile, run_again


@dataclass(frozen=True)
class Particles(ArrayFile):
    """particles.npz of sample_particles: N particles, K patches, G Gaussians, J tracks, B bonds.

    World frame, at frame 0. What is bound follows the particles `*_neighbours` with `*_weights` that sum to 1.

    Attributes:
        x0: [N, 3] m.
        volume: [N] m3.
        spacing: mean distance between neighbours [m].
        density: [N] kg/m3.
        patches: [K], the particle in the middle of each patch.
        patch_neighbours, patch_weights: [N, P], patches that each particle takes its material from.
        gaussian_neighbours, gaussian_weights: [G, M], particles that carry each Gaussian.
        track_ids: [J], tracks that lie on the object in frame 0, as numbered in `MeasuredTracks`.
        track_points0: [J, 3] m, where they are in frame 0.
        track_neighbours, track_weights: [J, L], particles that carry each track.
        grip_particles, grip_controllers: [B], a held particle and the controller point that holds it.
        grip_weights: [B], those of one particle sum to 1.
        grip_rest_lengths: [B] m; not a number for a bond that is as long as it is when taken.
        grip_reach: [B] m, how far the hand has to reach to hold the bond's particle, as of `Grip`; None: as far as its nearest point.
        grip_taken, grip_released: [B], frames from which each bond acts, and from which it does no more, -1 for never; None, both: it
            always acts.
        tool_ends: [Q, 2], of a hand that pushes: the controller points at the ends of each of its capsules; tool_radius [Q] m. None, both,
            for one that does not.
        tool_spared: [S], particles that it holds and does not push; None where there are none.
        unseen: [N], where the far side was guessed, how far a particle lies from the surface that was seen (0) to that side (1); None where
            the shape is known, and of thin bodies.
        pieces: [N], number from 0 of each particle's piece, which move apart; None where the mesh is one.
        triangles: [E, 3], of a shell: vertices, which the particles are, counter-clockwise from one side; thickness [m]; warp [3], the
            direction of a fabric's first threads. None, all three, for any other body.
        rows: [R], of rods: number of vertices of each, which follow one another; radius [m]. None, both, for any other body.
    """

    FILE = "particles.npz"
    REMEDY = run_again("sample_particles")

    x0: Float[Array, "N 3"]
    volume: Float[Array, " N"]
    spacing: float
    density: Float[Array, " N"]
    patches: Int[Array, " K"]
    patch_neighbours: Int[Array, "N P"]
    patch_weights: Float[Array, "N P"]
    gaussian_neighbours: Int[Array, "G M"]
    gaussian_weights: Float[Array, "G M"]
    track_ids: Int[Array, " J"]
    track_points0: Float[Array, "J 3"]
    track_neighbours: Int[Array, "J L"]
    track_weights: Float[Array, "J L"]
    grip_particles: Int[Array, " B"]
    grip_controllers: Int[Array, " B"]
    grip_weights: Float[Array, " B"]
    grip_rest_lengths: Float[Array, " B"]
    triangles: Int[Array, "E 3"] | None = None
    thickness: float | None = None
    warp: Float[Array, "3"] | None = None
    rows: Int[Array, " R"] | None = None
    radius: float | None = None
    pieces: Int[Array, " N"] | None = None
    grip_reach: Float[Array, " B"] | None = None
    grip_taken: Int[Array, " B"] | None = None
    grip_released: Int[Array, " B"] | None = None
    tool_ends: Int[Array, "Q 2"] | None = None
    tool_radius: Float[Array, " Q"] | None = None
    tool_spared: Int[Array, " S"] | None = None
    unseen: Float[Array, " N"] | None = None

    def __post_init__(self) -> None:
        shell, rod = (self.triangles, self.thickness, self.warp), (self.rows, self.radius)
        given = [sum(value is not None for value in group) for group in (shell, rod)]
        if (self.tool_ends is None) != (self.tool_radius is None):
            raise InputError(
                "capsules of a hand that are not whole",
                where=self.FILE,
                expected="tool_ends with tool_radius, or neither",
                remedy=self.REMEDY,
            )
        if given not in ([0, 0], [len(shell), 0], [0, len(rod)]):
            raise InputError(
                "elements of a thin body that are not whole",
                where=self.FILE,
                expected="triangles with thickness and warp, or rows with radius, or none of them",
                remedy=self.REMEDY,
            )

    @property
    def pushed(self) -> bool:
        """Whether a hand pushes the body."""
        return self.tool_ends is not None

    @property
    def geometry(self) -> str:
        """The kind of the body: volumetric, planar (a shell) or linear (rods)."""
        thin = "linear" if self.triangles is None else "planar"
        return "volumetric" if self.triangles is None and self.rows is None else thin

    @property
    def patch_positions(self) -> Float[Array, "K 3"]:
        """Where the patches lie at frame 0 [m]."""
        return self.x0[self.patches]
