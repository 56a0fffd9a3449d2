"""The capsules with which a hand or a tool pushes: those that are known of it, or those between the points that were seen of it.

In frame 0 the body is at rest, so nothing pushes it then. A capsule that reaches into it there by a few millimetres, as a hand does whose
place is known to as much, is made thinner by that.
"""

from collections.abc import Sequence

import numpy as np

from physreal_core.array_types import Array, Float, Int
from physreal_core.errors import InputError
from physreal_core.simulation import Body, Tool

LONGEST = 3.0
"""Times the middle length of the capsules between seen points is one that joins two hands and is left out."""

THINNEST = 0.25
"""Share of a capsule's radius that must be left where it is made thinner: else its middle lies in the body."""


def bind_tool(
    body: Body,
    controllers: Float[Array, "frames controllers 3"],
    *,
    ends: Int[Array, "capsules 2"] | None = None,
    radius: float | Sequence[float] | Float[Array, " capsules"],
    held: Int[Array, " held"] | None = None,
) -> Tool:
    """The capsules of a hand or a tool that pushes a body.

    Args:
        body: as it lies in frame 0.
        controllers: controller points [m], without gaps.
        ends: the controller points at the ends of each capsule, where the shape of the tool is known; None joins the points that were seen of
            a hand by the shortest tree.
        radius: of each capsule, or of all [m].
        held: particles that the same hand holds, which it does not push.

    Raises:
        InputError: there are no points or a gap in them, the capsules do not fit them, one lies in the body in frame 0, or none ever
            comes near the place where the body lies then.
    """
    _check_points(controllers)
    given = ends is not None
    ends = np.asarray(ends, int).reshape(-1, 2) if given else _shortest_tree(controllers[0].astype(float))
    tool = Tool(ends, np.broadcast_to(np.asarray(radius, float), len(ends)), held)
    if tool.ends.max() >= controllers.shape[1]:
        raise InputError(
            f"a capsule ends at controller point {tool.ends.max()} of {controllers.shape[1]}",
            where="the capsules of the controller",
            expected=f"numbers below {controllers.shape[1]}",
        )
    tool = _outside(tool, body, controllers[0].astype(float), given)
    if held is None or not len(held):
        _require_contact(tool, body, controllers)
    return tool


def _check_points(controllers: Array) -> None:
    if controllers.shape[1] == 0:
        raise InputError(
            "no controller point",
            where="sample_particles.grip.contact",
            expected="a hand or a tool that pushes",
            remedy="check the controller's mask, give the controller's points with the capture, or set contact: hold",
        )
    if not np.isfinite(controllers).all():
        frame = int(np.argwhere(~np.isfinite(controllers))[0, 0])
        raise InputError(
            "a controller point is not known",
            where=f"the controller, frame {frame}",
            expected="positions in all frames [m]",
        )


def _shortest_tree(points: Float[Array, "controllers 3"]) -> Int[Array, "capsules 2"]:
    """Pairs of points that join all of them by the least length, without the long ones; a point that is left alone is a ball."""
    from scipy.sparse.csgraph import minimum_spanning_tree
    from scipy.spatial.distance import pdist, squareform

    lengths = squareform(pdist(points))
    tree = minimum_spanning_tree(lengths).tocoo()
    near = tree.data <= LONGEST * np.median(tree.data) if len(tree.data) else np.zeros(0, bool)
    pairs = np.stack([tree.row[near], tree.col[near]], axis=1)
    alone = np.setdiff1d(np.arange(len(points)), pairs)
    return np.concatenate([pairs, np.stack([alone, alone], axis=1)])


def _outside(tool: Tool, body: Body, points: Array, given: bool) -> Tool:
    """The capsules that do not lie in the body, as thick as they may be without reaching into it."""
    gaps = np.array([_gap(tool, body, points, number) for number in range(len(tool.ends))])
    thickness = np.minimum(tool.radius, gaps)
    kept = thickness >= THINNEST * tool.radius
    if given and not kept.all():
        number = int(np.argmin(thickness / tool.radius))
        a, b = tool.ends[number]
        raise InputError(
            f"the capsule between controller points {a} and {b} lies in the object in frame 0: its surface is "
            f"{tool.radius[number] - gaps[number]:.4f} m within the nearest particle",
            where="the capsules of the controller",
            expected="a tool beside the object then",
            remedy="check the tool's points and the object's pose, or set sample_particles.grip.contact: hold_and_push where it holds too",
        )
    if not kept.any():
        raise InputError(
            "all of the hand lies in the object in frame 0",
            where="sample_particles.grip.contact",
            expected="a hand beside the object then",
            remedy="lower sample_particles.grip.push_radius, or set contact to hold or hold_and_push where it holds the object",
        )
    return Tool(tool.ends[kept], thickness[kept], tool.spared)


def _gap(tool: Tool, body: Body, points: Array, number: int) -> float:
    """Distance of a capsule's middle line from the nearest surface of a particle that it may push [m]."""
    return float((distances_to_line(body.x0, *points[tool.ends[number]]) - tool.reach(body)).min())


def _require_contact(tool: Tool, body: Body, controllers: Array) -> None:
    nearest, when = np.inf, 0
    for frame, points in enumerate(controllers.astype(float)):
        gaps = np.array([_gap(tool, body, points, number) for number in range(len(tool.ends))]) - tool.radius
        if gaps.min() <= 0.0:
            return
        if gaps.min() < nearest:
            nearest, when = float(gaps.min()), frame
    raise InputError(
        f"the hand pushes nothing: it comes nearest in frame {when}, {nearest:.4f} m beside where the object lies in frame 0",
        where="sample_particles.grip.contact",
        expected="a hand that comes to the object",
        remedy="raise sample_particles.grip.push_radius, check the controller's points and the object's pose, or set contact: hold",
    )


def distances_to_line(
    x: Float[Array, "points 3"], start: Float[Array, " 3"], end: Float[Array, " 3"]
) -> Float[Array, " points"]:
    """Distances of points from the line between two points [m]."""
    axis = end - start
    along = np.clip((x - start) @ axis / max(float(axis @ axis), 1e-18), 0.0, 1.0)
    return np.linalg.norm(x - start - along[:, None] * axis, axis=1)
