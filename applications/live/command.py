"""`physreal live`: replays a recorded sequence as a stream, follows it, and says how that went."""

import argparse
import time

from applications.coarse import coarser
from applications.live.following import Following
from applications.live.pace import in_real_time
from applications.live.streams import recorded
from applications.options import require
from applications.play.film import film
from applications.twin import Twin
from physreal_core.following import FollowConfig, follower_of
from pipeline.graph import FIT_STAGES
from pipeline.project import Project
from pipeline.whole_folder import as_a_whole, require_new


def live(parsed: argparse.Namespace) -> None:
    """Does what the command line asks for.

    Raises:
        InputError: as of `Twin.load`, `coarser`, `Follower` and `recorded`; the folder is there already, or an option does not fit.
    """
    require(parsed.speed >= 0, f"{parsed.speed:g}", "physreal live --speed", "0 or more")
    project = Project.find()
    folder = parsed.to or project.root / "data" / "followed" / parsed.sequence
    require_new(folder, "physreal live")
    full = Twin.load(project, parsed.sequence, parsed.model or FIT_STAGES[-1])
    twin = coarser(full, parsed.coarser, "physreal live")
    followed = follow(twin, parsed.speed, parsed.device, _config(parsed.learn))
    with as_a_whole(folder) as draft:
        followed.write(draft)
        if parsed.record:
            film(twin, followed.states(), draft / "live.mp4", followed.fps)
    print(followed.told())
    print(f"wrote {folder}")


def _config(learn: float | None) -> FollowConfig:
    require(learn is None or learn > 0, f"{learn}", "physreal live --learn", "more than 0")
    return FollowConfig(learns={} if learn is None else {"youngs_modulus": learn})


def follow(twin: Twin, speed: float, device: str = "cpu", config: FollowConfig | None = None) -> Following:
    """The recorded sequence of a twin, followed."""
    follower, done = follower_of(twin.problem, twin.model, config, device), Following(float(twin.problem.fps))
    begun = time.perf_counter()
    for frame, (seen, in_time) in enumerate(in_real_time(recorded(twin.problem), done.fps, speed), start=1):
        if in_time:
            done.add(frame, follower.step(seen))
            done.learnt += follower.learnt
        else:
            follower.go_on(seen.controllers)
            done.add(frame, None)
    done.seconds = time.perf_counter() - begun
    done.material = {} if follower.material is None else follower.material.told()
    return done
