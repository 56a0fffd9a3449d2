"""Closed meshes where no mesh was given: from one RGB-D view and the support plane, or from a cloud of Gaussians."""

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from physreal_core.geometry.mesh import Mesh, oriented, require_closed
from physreal_core.geometry.observation import Observation
from physreal_core.geometry.parts import largest_part
from physreal_core.rendering import Gaussians

SEAL = 2.5  # [voxels] gaps in a shell of Gaussians up to twice as wide are closed
HAND_REACH = 0.05  # [m] of the object: the part of a hand that may hold it
FLAT = 0.8  # share of seen columns nearly as high as the ridge, from which on a top counts as flat
SUNK = 0.02, 0.1  # [m] below the plane, and the share of an object's points that may lie so deep
PAD = 3  # empty voxels around everything, and below the support plane


def mesh_from_view(observation: Observation, *, voxel: float = 0.004, underside: str = "round") -> Mesh:
    """Closes the surface seen in frame 0 down to the support plane z = 0; world frame.

    The thickness rule, column by column over the plane: the body reaches from the seen top z_top down to
    max(0, H - z_top), where H is the greatest seen height within the distance z_top. A body that lies on the plane with
    a section as round as it is high is met exactly. Where the top is flat, the body goes down to the plane, as a box does. What a
    round body hides behind itself is filled by balls: under every ridge (z_top = H) the ball of diameter H, if all of it lies behind
    the seen surface and inside the silhouette. With underside = "flat" all columns go down to the plane and there are no balls.

    What the hand hides between seen parts (in their convex hull) is as high as the nearest ridge. An end that goes into the hand goes on
    with the same section, to the far side of what the hand has near the body.

    Args:
        observation: frame 0 with depth; the object touches the plane z = 0.
        voxel: edge [m] of the voxels that the mesh is drawn around.

    Raises:
        InputError: too little depth, nothing above the plane, or much of the object below it.
    """
    observation.require_depth()
    points = observation.points()
    _require_above_the_plane(points)
    points = points[points[:, 2] > 0.5 * voxel]
    if len(points) < 20:
        raise InputError(
            f"{len(points)} object points lie above the support plane in frame 0",
            where="build_object",
            expected="at least 20",
            remedy="check the depth scale and T_world_camera in capture.json",
        )
    low, high = np.percentile(points, [0.2, 99.8], axis=0)
    margin = max(high[2], HAND_REACH) * np.array([1.0, 1.0, 0.0])
    low = np.array([low[0], low[1], 0.0]) - margin - PAD * voxel
    shape = np.ceil((high + margin + PAD * voxel - low) / voxel).astype(int)
    free = _known_empty(observation, low, voxel, shape)
    top = _seen_tops(points, low, voxel, shape)
    top = _bridged(top, observation, low, voxel)
    top = _into_the_hand(top, observation, low, voxel)
    ridge = _local_height(top, voxel)
    flat = _flat(top, ridge, voxel) | (underside == "flat")
    solid = _columns(top, np.where(flat, 0.0, ridge - top), low, voxel, shape)
    if underside == "round":
        down = -float(observation.camera.T_world_camera[2, 2])
        solid |= _balls(top, (top > 0.95 * ridge) & ~flat, free, low, voxel, down)
    return _mesh_around(_main_body(solid & ~free), low, voxel)


def mesh_from_gaussians(gaussians: Gaussians, voxels_across: int = 64) -> Mesh:
    """Closed mesh around a hollow cloud of Gaussians: voxels with an opaque centre, gaps closed, inside filled.

    Raises:
        InputError: the cloud does not enclose anything at this resolution.
    """
    from scipy import ndimage

    points = gaussians.means[gaussians.opacities() > 0.3].detach().double().numpy()
    if len(points) < 100:
        raise InputError(f"{len(points)} opaque Gaussians", where="shape_prior.ply", expected="at least 100")
    low, high = np.percentile(points, [0.1, 99.9], axis=0)
    voxel = float((high - low).max()) / voxels_across
    points = points[((points > low - 2 * voxel) & (points < high + 2 * voxel)).all(axis=1)]
    low = low - (PAD + 6) * voxel
    shape = np.ceil((high + (PAD + 6) * voxel - low) / voxel).astype(int)
    shell = np.zeros(shape, bool)
    shell[tuple(((points - low) / voxel).astype(int).T)] = True
    # Closing by a ball: thick enough to seal the gaps, filled, and taken off again.
    thick = ndimage.binary_fill_holes(ndimage.distance_transform_edt(~shell) <= SEAL)
    solid = _main_body(ndimage.distance_transform_edt(thick) > SEAL)
    if (ndimage.distance_transform_edt(solid) > 2).sum() < 0.1 * solid.sum():
        raise InputError(
            "the Gaussians do not enclose a volume",
            where="shape_prior.ply",
            expected="a closed shell of Gaussians",
            remedy="add shape_prior.glb, or lower build_object.voxels_across",
        )
    # The Gaussians' centres lie in the middle of the outermost voxels on average, half a voxel inside the solid's edge.
    return _mesh_around(solid, low, voxel, inside=0.5)


def mesh_from_balls(centres: Float[Array, "balls 3"], radii: Float[Array, " balls"], *, voxel: float = 0.004) -> Mesh:
    """Closed mesh around the largest connected part of a union of balls, above the plane z = 0; world frame.

    Args:
        centres, radii: [m], as `resting.resting_balls` gives them.
        voxel: edge [m] of the voxels that the mesh is drawn around.

    Raises:
        InputError: there is nothing that is larger than a voxel.
    """
    low = np.append((centres - radii[:, None]).min(0)[:2], 0.0) - PAD * voxel
    high = (centres + radii[:, None]).max(0) + PAD * voxel
    shape = np.ceil((high - low) / voxel).astype(int)
    first = low + 0.5 * voxel
    where = np.broadcast_to(first[2] + voxel * np.arange(shape[2]) > 0.0, shape)
    return _mesh_around(_main_body(_union(centres - first, radii, where, voxel)), low, voxel)


def _require_above_the_plane(points: Float[Array, "n 3"]) -> None:
    """InputError where so much of the object [m] lies below the plane that depth and camera pose contradict each other."""
    below = float(np.mean(points[:, 2] < -SUNK[0]))
    if below > SUNK[1]:
        raise InputError(
            f"{100 * below:.0f} % of the object's points in frame 0 lie more than {100 * SUNK[0]:.0f} cm below the support plane",
            where="build_object",
            expected=f"at most {100 * SUNK[1]:.0f} %",
            remedy="check the depth scale and T_world_camera in capture.json; quality.json of parse_video says where the depth shows "
            "the plane, which defines the world if T_world_camera is left out",
        )


def _known_empty(observation: Observation, low: Array, voxel: float, shape: Array) -> Bool[Array, "X Y Z"]:
    """Voxels below the plane, outside the silhouette, or in front of the seen surface."""
    from scipy import ndimage

    centres = low + (np.stack(np.indices(shape), axis=-1) + 0.5) * voxel
    pixels, z = observation.camera.project(torch.as_tensor(centres))
    u, v = np.rint(pixels.numpy()).astype(int).transpose(3, 0, 1, 2)
    height, width = observation.mask.shape
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height) & (z.numpy() > 0)
    u, v = np.clip(u, 0, width - 1), np.clip(v, 0, height - 1)
    # Missing readings take the nearest one of the object.
    nearest = ndimage.distance_transform_edt(~observation.measured, return_distances=False, return_indices=True)
    depth = ndimage.median_filter(observation.depth[tuple(nearest)], 3)
    background = ~observation.mask & ~observation.hidden
    in_front = observation.mask[v, u] & (z.numpy() < depth[v, u] - 0.5 * voxel)
    return (inside & (background[v, u] | in_front)) | (centres[..., 2] < 0)


def _seen_tops(points: Array, low: Array, voxel: float, shape: Array) -> Float[Array, "X Y"]:
    """Greatest seen height [m] per column, 0 where nothing is seen; single gaps closed."""
    from scipy import ndimage

    top = np.zeros(shape[:2])
    x, y = ((points[:, :2] - low[:2]) / voxel).astype(int).T
    inside = (x >= 0) & (x < shape[0]) & (y >= 0) & (y < shape[1])
    np.maximum.at(top, (x[inside], y[inside]), points[inside, 2])
    return np.where(top > 0, top, ndimage.grey_closing(top, size=(3, 3)))


def _bridged(top: Float[Array, "X Y"], observation: Observation, low: Array, voxel: float) -> Float[Array, "X Y"]:
    """Columns that the hand hides, within the convex hull of the seen ones, take the height of the nearest ridge."""
    from scipy import ndimage
    from skimage.morphology import convex_hull_image

    seen = top > 0
    if not observation.hidden.any():
        return top
    ridge = top > 0.9 * _local_height(top, voxel)
    nearest = ndimage.distance_transform_edt(~(seen & ridge), return_distances=False, return_indices=True)
    height = top[tuple(nearest)]
    between = _hidden_columns(height / 2, observation, low, voxel) & convex_hull_image(seen)
    return np.where(between, np.maximum(top, height), top)


def _into_the_hand(top: Float[Array, "X Y"], observation: Observation, low: Array, voxel: float) -> Float[Array, "X Y"]:
    """Hidden columns past the edge where the body goes into the hand take the greatest height along a line back to it.

    The line runs from the middle of what is seen near the edge to the middle of the edge.
    """
    from scipy import ndimage

    if not observation.hidden.any():
        return top
    seen, hand = top > 0, observation.hand_points(HAND_REACH)
    height = ndimage.grey_dilation(top, footprint=_disc(HAND_REACH / voxel))
    hidden = np.any([_hidden_columns(share * height, observation, low, voxel) for share in (0.5, 1.0)], axis=0)
    edge = seen & ndimage.binary_dilation(hidden & ~seen, iterations=2)
    if len(hand) == 0 or not edge.any():
        return top
    middle = np.argwhere(edge).mean(0)
    near = np.argwhere(seen)
    way = middle - near[np.linalg.norm(near - middle, axis=1) < HAND_REACH / voxel].mean(0)
    if not way.any():
        return top
    way /= np.linalg.norm(way)
    far = np.percentile(((hand[:, :2] - low[:2]) / voxel - 0.5) @ way, 95)
    steps = np.unique(np.rint(np.arange(0.0, HAND_REACH / voxel, 0.5)[:, None] * way).astype(int), axis=0)
    swept = np.max([ndimage.shift(top, step, order=0) for step in steps], axis=0)
    within = hidden & (np.moveaxis(np.indices(top.shape), 0, -1) @ way <= far)
    return np.where(within, np.maximum(top, swept), top)


def _hidden_columns(
    height: Float[Array, "X Y"], observation: Observation, low: Array, voxel: float
) -> Bool[Array, "X Y"]:
    """Columns that the hand hides at a height [m]."""
    x, y = low[:2, None, None] + (np.indices(height.shape) + 0.5) * voxel
    pixels, _ = observation.camera.project(torch.as_tensor(np.stack([x, y, height], axis=-1)))
    u, v = np.rint(pixels.numpy()).astype(int).transpose(2, 0, 1)
    rows, columns = observation.hidden.shape
    return observation.hidden[np.clip(v, 0, rows - 1), np.clip(u, 0, columns - 1)]


def _local_height(top: Float[Array, "X Y"], voxel: float) -> Float[Array, "X Y"]:
    """H: the greatest height within the distance of each column's own height."""
    from scipy import ndimage

    radius = np.rint(top / voxel).astype(int)
    height = np.zeros_like(top)
    for r in np.unique(radius[top > 0]):
        height = np.where(radius == r, ndimage.maximum_filter(top, footprint=_disc(float(r))), height)
    return np.where(top > 0, height, 0)


def _disc(radius: float) -> Bool[Array, "side side"]:
    r = int(radius)
    return np.hypot(*np.mgrid[-r : r + 1, -r : r + 1]) <= radius


def _flat(top: Float[Array, "X Y"], ridge: Float[Array, "X Y"], voxel: float) -> Bool[Array, "X Y"]:
    """Columns around which the top is flat, as a box's is.

    Of a ball's seen columns, half are higher than 0.9 of it, and of a box's all but those that noise takes out. How far the surface
    falls towards the far side tells less: a camera sees the last 0.3 radii of a ball in one row of pixels.
    """
    from scipy import ndimage

    apart = top.max() / 2.0 / voxel
    high, seen = (ndimage.gaussian_filter((top > level).astype(float), apart) for level in (0.9 * ridge, 0.0))
    return high > FLAT * seen


def _columns(top: Array, bottom: Array, low: Array, voxel: float, shape: Array) -> Bool[Array, "X Y Z"]:
    z = low[2] + (np.arange(shape[2]) + 0.5) * voxel
    return (z < top[..., None]) & (z > bottom[..., None])


def _balls(top: Array, ridges: Array, free: Array, low: Array, voxel: float, down: float) -> Bool[Array, "X Y Z"]:
    """Balls between plane and round ridges that hold no empty voxel; `down` is the sine of the camera's tilt.

    A ball of radius r is seen until r sin(tilt) past its top, and one much nearer to unseen columns is not where it seems.
    """
    from scipy import ndimage

    x, y = np.nonzero((top > 2 * voxel) & ridges)
    radius = top[x, y] / 2
    centres = np.stack([x, y, (radius - low[2]) / voxel - 0.5])
    room = ndimage.map_coordinates(ndimage.distance_transform_edt(~free), centres, order=1) * voxel
    seen_past = ndimage.distance_transform_edt(top > 0)[x, y] * voxel
    fits = (room > radius - voxel) & (seen_past > 0.4 * down * radius)
    return _union(voxel * centres.T[fits], radius[fits], ~free, voxel)


def _union(
    centres: Float[Array, "N 3"], radius: Float[Array, " N"], where: Bool[Array, "X Y Z"], voxel: float
) -> Array:
    """The voxels within any of the balls, centres [m] from the centre of the first voxel.

    |x - c|^2 < r^2 is |(x, 0) - (c, sqrt(R^2 - r^2))|^2 < R^2: the nearest of points in four dimensions decides.
    """
    from scipy.spatial import cKDTree

    solid = np.zeros_like(where)
    if len(centres):
        widest = radius.max()
        tree = cKDTree(np.column_stack([centres, np.sqrt(widest**2 - radius**2)]))
        voxels = np.argwhere(where)
        nearest, _ = tree.query(np.pad(voxel * voxels, ((0, 0), (0, 1))), distance_upper_bound=widest)
        solid[tuple(voxels[nearest < widest].T)] = True
    return solid


def _main_body(solid: Bool[Array, "X Y Z"]) -> Bool[Array, "X Y Z"]:
    """The largest connected part, without cavities."""
    from scipy import ndimage

    if not solid.any():
        raise InputError("nothing solid is left of the object", where="build_object", remedy="lower build_object.voxel")
    return ndimage.binary_fill_holes(largest_part(solid))


def _mesh_around(solid: Bool[Array, "X Y Z"], low: Array, voxel: float, inside: float = 0.0) -> Mesh:
    """Marching cubes (Lewiner) on the smoothed signed distance to the solid's edge, `inside` voxels within it."""
    from scipy import ndimage
    from skimage.measure import marching_cubes

    solid = np.pad(solid, PAD)
    distance = ndimage.distance_transform_edt(solid) - ndimage.distance_transform_edt(~solid)
    distance -= 0.5 * np.sign(distance)
    vertices, faces, _, _ = marching_cubes(ndimage.gaussian_filter(distance, 0.8), inside)
    vertices = low + (vertices + 0.5 - PAD) * voxel
    return require_closed(oriented(vertices, faces, None), where="build_object")
