"""Parameters of `sample_particles`: particles, patches, and what is bound to them."""

from typing import Literal

from pydantic import Field

from pipeline.config._base import StageParameters


class GripParameters(StageParameters):
    """What the controller does to the object: which particles it holds, and how wide it is where it pushes."""

    contact: Literal["hold", "push", "hold_and_push"] = Field(
        "hold",
        description="the controller holds what is near it; or pushes it without holding, with friction; or does both",
    )
    push_radius: float = Field(
        0.006,
        gt=0,
        description="the controller pushes with capsules of this radius between its points, where controllers.npz gives none [m]",
    )

    radius: float = Field(
        0.016,
        gt=0,
        description="particles this near to a controller point are held; of a sheet those between the points this near to it [m]",
    )
    per_particle: int = Field(8, ge=1, description="controller points a particle is bound to at most")
    holds: Literal["from_frame_0", "measured"] = Field(
        "from_frame_0",
        description="when the controller holds: all the time; or while the object goes where it goes, so that it may come late, let go and take again",
    )


class SampleParticles(StageParameters):
    """Material particles in the mesh, patches of the material field, bindings of Gaussians, tracks and grip."""

    spacing: float = Field(
        0.008,
        gt=0,
        description="particle spacing h; the grid's cells are 2 h. Edges of a shell's triangles, segments of a rod [m]",
    )
    jitter: float = Field(0.0, ge=0, le=1, description="random displacement of the particles [fraction of h]")
    density: float = Field(300.0, gt=0, description="used where capture.json gives none [kg/m3]")
    thickness: float | None = Field(
        None,
        gt=0,
        description="of a cloth, or the diameter of a rope, where capture.json gives none; null: as the mesh has it [m]",
    )
    warp: tuple[float, float, float] = Field(
        (1.0, 0.0, 0.0), description="direction of a cloth's first threads in frame 0, world; laid into its surface"
    )
    patches: int = Field(12, ge=1, description="patches K of the material field")
    patch_neighbours: int = Field(4, ge=1, description="patches that a particle takes its material from")
    binding_neighbours: int = Field(
        8,
        ge=1,
        description="particles that carry a Gaussian or a track; a thin body's are the corners of a triangle or segment",
    )
    track_distance: float = Field(
        0.01, gt=0, description="a track belongs to the object if it lies this near to its surface in frame 0 [m]"
    )
    grip: GripParameters = Field(default_factory=GripParameters)
