"""`physreal play`: the page, or a video without one."""

import argparse

from applications.play.film import film, read_log, written
from applications.twin import Twin
from physreal_core.errors import InputError
from physreal_core.playing import replayed
from pipeline.graph import FIT_STAGES
from pipeline.project import Project


def play(parsed: argparse.Namespace) -> None:
    """Does what the command line asks for.

    Raises:
        InputError: as of `Twin.load`, `serve` and `read_log`; and where neither a sequence nor a log is named.
    """
    sequence, stage, actions, frames = parsed.sequence, parsed.model, [], None
    if parsed.replay is not None:
        of_log, stage_of_log, actions, frames = read_log(parsed.replay)
        sequence, stage = sequence or of_log, stage or stage_of_log
    if sequence is None:
        raise InputError(
            "no sequence", where="physreal play", expected="a name under `fits` in params.yaml, or --replay LOG"
        )
    stage = stage or FIT_STAGES[-1]
    if parsed.replay is not None and parsed.record is None:
        raise InputError(
            "a log without a video", where="physreal play --replay", expected="--record FILE.mp4 beside it"
        )
    if parsed.record is None:
        from applications.play.serve import HOST, PORT, serve

        serve(
            sequence,
            stage=stage,
            beside=parsed.beside,
            folder=parsed.captures,
            device=parsed.device,
            host=parsed.host or HOST,
            port=parsed.port or PORT,
            browser=not parsed.no_browser,
        )
        return
    twin = Twin.load(Project.find(), sequence, stage)
    session = twin.session(parsed.device)
    count = parsed.frames or frames or session.frames_filmed - 1
    places = film(twin, replayed(session, actions, count), parsed.record, session.fps)
    print(written(parsed.record, places))
