"""Parameters of `fit_pose`: how long to search for the object's pose and scale, and how to refine it."""

from pydantic import Field

from pipeline.config._base import StageParameters


class FitPose(StageParameters):
    """Differential evolution over rotation, translation and scale, then gradient descent through the renderer."""

    restarts: int = Field(2, ge=1, description="independent evolutions")
    population: int = Field(84, ge=14, description="candidates per generation")
    generations: int = Field(80, ge=1, description="generations per evolution")
    candidates: int = Field(2, ge=1, description="distinct poses found that are refined by gradient descent")
    coarse_iterations: int = Field(80, ge=1, description="gradient steps per candidate at half the resolution")
    fine_iterations: int = Field(60, ge=1, description="gradient steps of the best one at full resolution")
    surface_points: int = Field(3000, ge=500, description="points on the surface that are compared with frame 0")
    rests_on_plane: bool = Field(True, description="whether the object touches the support plane in frame 0")
    silhouette_inset: float = Field(
        0.65,
        ge=0,
        le=1,
        description="how far the Gaussians lie below the surface: 0 not at all, 1 so that alpha > 0 ends at the silhouette",
    )
    paint_iterations: int = Field(40, ge=0, description="renderings spent on the Gaussians' colours")
