"""sample_particles: material particles, patches of the material field, and what is bound to them (eqs.
particle_initialization, gs_binding, patch_to_particle, interaction_force).

The particles fill a volume; those of a cloth or a rope are the vertices of a shell in its middle surface or of a rod in its
centre line.
"""

import numpy as np

from physreal_core.errors import InputError
from physreal_core.fitting.grip import Hides, bind_grip, bind_holds, no_bonds
from physreal_core.fitting.hiding import hidden_by_hand
from physreal_core.fitting.thin import bind_to_body, cells_of, ways_along
from physreal_core.fitting.tool import bind_tool
from physreal_core.fitting.unseen import unseen_share
from physreal_core.geometry import Hold, Mesh, carried, farthest_points, holds_of, patch_weights, sample_surface
from physreal_core.simulation import Body, Grip, Tool
from pipeline.capture import Capture, read_capture
from pipeline.config.sample_particles import GripParameters
from pipeline.products.controllers import Controllers
from pipeline.products.images import FrameImages
from pipeline.products.masks import Masks
from pipeline.products.particles import Particles
from pipeline.products.placed_object import PlacedObject
from pipeline.products.tracks import MeasuredTracks
from pipeline.stage import StageContext, main
from stages._body import Material, elements_of, make_body, require_geometry
from stages._camera import load_camera
from stages._grip import fields_of

HOLD_REACH = 2.0
"""Times the grip's radius from the controller's points are tracks of the object that tell whether it is held."""


def run(context: StageContext) -> None:
    """Make the body in the aligned mesh, choose patches, bind Gaussians, tracks and controller; write particles.npz."""
    params, placed = context.params, PlacedObject.load(context.input("fit_pose"))
    perceived = context.input("segment_and_track")
    capture = read_capture(context.input("parse_video"))
    require_geometry(capture, context.geometry, context.sequence)
    material = Material.of(capture, params)
    body = make_body(context.geometry, placed, context.capture, material, params, context.seed)
    ways = ways_along(body)
    patches = farthest_points(body.x0, params.patches, ways=ways)
    patch_neighbours, weights = patch_weights(body.x0, patches, params.patch_neighbours, ways)
    gaussians = bind_to_body(placed.gaussians.means, body, params.binding_neighbours)
    hand = Controllers.load(perceived)
    measured = MeasuredTracks.load(perceived)
    ids = tracks_on(placed.mesh, measured.points3d[0], measured.valid3d[0], params.track_distance)
    points0 = measured.points3d[0, ids].astype(float)
    tracks = bind_to_body(points0, body, params.binding_neighbours)
    sheet = context.geometry == "planar"
    known = measured.points3d[:, ids], measured.valid3d[:, ids]
    grip = _grip(body, hand.points, *known, capture, params.grip, sheet=sheet, hides=_hides(context, capture))
    tool = _tool(body, hand, grip, params.grip)
    Particles(
        x0=body.x0,
        volume=body.volume,
        spacing=body.spacing,
        density=body.density,
        patches=patches,
        patch_neighbours=patch_neighbours,
        patch_weights=weights,
        gaussian_neighbours=gaussians.neighbours.numpy(),
        gaussian_weights=gaussians.weights.numpy(),
        track_ids=ids,
        track_points0=points0,
        track_neighbours=tracks.neighbours.numpy(),
        track_weights=tracks.weights.numpy(),
        unseen=_unseen(context, placed, body),
        **fields_of(grip, tool),
        **elements_of(body),
    ).save(context.output)
    held, cells = len(np.unique(grip.particles)), cells_of(body)
    kind = "" if cells is None else f" of {len(cells)} {'triangles' if cells.shape[1] == 3 else 'segments'}"
    print(f"{len(body.x0)} particles{kind}, {len(ids)} tracks, {held} particles held by {len(grip.weights)} bonds")
    if tool is not None:
        print(
            f"the controller pushes with {len(tool.ends)} capsules of {1e3 * tool.radius.min():.1f} mm to {1e3 * tool.radius.max():.1f} mm"
        )


def _unseen(context: StageContext, placed: PlacedObject, body: Body) -> np.ndarray | None:
    """Of a volume whose far side was guessed, how far each particle lies behind what the camera saw."""
    if not placed.far_side_guessed or body.elements is not None:
        return None
    return unseen_share(body.x0, body.spacing, load_camera(context.input("parse_video")))


def _grip(
    body: Body,
    controllers: np.ndarray,
    points: np.ndarray,
    valid: np.ndarray,
    capture: Capture,
    params: GripParameters,
    *,
    sheet: bool = False,
    hides: Hides | None = None,
) -> Grip:
    """What the controller holds, nothing where it only pushes: all the time, in the frames that the capture states, or while the tracks on the object go where it goes."""
    if params.contact == "push":
        return _nothing_held(capture)
    size = {"radius": params.radius, "spacing": body.spacing, "per_particle": params.per_particle}
    how = {**size, "sheet": sheet, "hides": hides}
    if controllers.shape[1] == 0 or (capture.holds is None and params.holds == "from_frame_0"):
        return bind_grip(body.x0, controllers, **how)
    seen = slice(capture.observed(len(points)).train[1])  # what the fit may see; the last state lasts
    points, valid = np.where(valid[seen, :, None], points[seen], 0.0).astype(float), valid[seen]
    if capture.holds is not None:
        holds = [Hold(*ends) for ends in capture.holds]
    else:
        reach = HOLD_REACH * params.radius
        holds = holds_of(controllers[seen].astype(float), points, valid, reach=reach, fps=capture.fps)
    for hold in holds:
        end = "to the end" if hold.released is None else f"to frame {hold.released}"
        print(f"the controller holds from frame {hold.taken} {end}")
    where = lambda frame: carried(body.x0, points, valid, min(frame, len(points) - 1))
    return bind_holds(body.x0, controllers, holds, where, **how)


def _hides(context: StageContext, capture: Capture) -> Hides | None:
    """Which particles of a volume the hand hides from the camera that filmed it; all of them where its mask is empty."""
    if context.geometry != "volumetric" or capture.kind != "video":
        return None
    parsed, perceived = context.input("parse_video"), context.input("segment_and_track")
    images, camera = FrameImages(parsed), load_camera(parsed)

    def hides(frame: int, x: np.ndarray) -> np.ndarray:
        hand, depth = Masks.load(perceived, [frame]).controller[0], images.depth(frame)
        if not hand.any():
            return np.ones(len(x), bool)
        return hidden_by_hand(x, camera, hand, None if depth is None else depth / 1000.0)

    return hides


def _nothing_held(capture: Capture) -> Grip:
    if capture.holds is not None:
        raise InputError(
            "the capture states when the controller holds, and it shall only push",
            where="capture.json, holds, and sample_particles.grip.contact = push",
            expected="one of the two",
            remedy="set sample_particles.grip.contact to hold or hold_and_push, or take holds out of capture.json",
        )
    return no_bonds()


def _tool(body: Body, hand: Controllers, grip: Grip, params: GripParameters) -> Tool | None:
    """With what the controller pushes: the capsules that are given, or those between the points that were seen of it."""
    if params.contact == "hold":
        return None
    radius = params.push_radius if hand.radius is None else hand.radius
    return bind_tool(body, hand.points, ends=hand.ends, radius=radius, held=np.unique(grip.particles))


def tracks_on(mesh: Mesh, points0: np.ndarray, valid: np.ndarray, reach: float) -> np.ndarray:
    """Tracks that are known in frame 0 and lie there within `reach` [m] of the surface.

    Args:
        mesh: world frame [m].
        points0: [J, 3] m, in frame 0; valid: [J].
    """
    from scipy.spatial import cKDTree

    points = points0.astype(float)
    known = np.flatnonzero(valid & np.isfinite(points).all(axis=1))
    surface = np.concatenate([mesh.vertices, sample_surface(mesh, 2000, oversampling=1).points])
    distance, _ = cKDTree(surface).query(points[known]) if len(known) else (np.empty(0), None)
    return known[distance < reach]


if __name__ == "__main__":
    main("sample_particles", run)
