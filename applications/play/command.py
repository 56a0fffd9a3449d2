"""`physreal play`: the page, or a video without one."""

import argparse

from applications.play.film import Log, film, written
from applications.twin import Twin
from physreal_core.errors import InputError
from physreal_core.playing import replayed
from pipeline.graph import FIT_STAGES
from pipeline.project import Project


def play(parsed: argparse.Namespace) -> None:
    """Does what the command line asks for.

    Raises:
        InputError: as of `Twin.load`, `serve` and `Log.read`; and where neither a sequence nor a log is named.
    """
    log = None if parsed.replay is None else Log.read(parsed.replay)
    sequence = parsed.sequence or (log and log.sequence)
    stage = parsed.model or (log.stage if log else FIT_STAGES[-1])
    if sequence is None:
        raise InputError(
            "no sequence", where="physreal play", expected="a name under `fits` in params.yaml, or --replay LOG"
        )
    if log is not None and parsed.record is None:
        raise InputError(
            "a log without a video", where="physreal play --replay", expected="--record FILE.mp4 beside it"
        )
    if parsed.record is None:
        from applications.play.serve import HOST, PORT, serve

        serve(
            sequence,
            stage=stage,
            beside=parsed.beside,
            interval=parsed.interval,
            folder=parsed.captures,
            device=parsed.device,
            ball=parsed.ball,
            scene=parsed.scene,
            backdrop=parsed.backdrop,
            host=parsed.host or HOST,
            port=parsed.port or PORT,
            browser=not parsed.no_browser,
        )
        return
    scene, backdrop = log.scene if log else parsed.scene, parsed.backdrop or (log and log.backdrop)
    twin = Twin.load(Project.find(), sequence, stage, scene, backdrop)
    session = twin.session(parsed.device, ball=log.ball if log else None)
    count = parsed.frames or (log.frames if log else session.frames_filmed - 1)
    places = film(twin, replayed(session, log.actions if log else [], count), parsed.record, session.fps)
    print(written(parsed.record, places))
