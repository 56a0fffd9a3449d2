"""Serves the page until it is ended."""

import importlib.util
import signal
import threading
import webbrowser
from pathlib import Path

from applications.twin import Twin
from physreal_core.errors import InputError
from physreal_core.playing import Session
from pipeline.graph import FIT_STAGES
from pipeline.project import Project
from pipeline.serving import require_free

HOST, PORT = "127.0.0.1", 8080


def serve(
    sequence: str,
    *,
    stage: str = FIT_STAGES[-1],
    beside: bool = False,
    interval: bool = False,
    folder: Path | None = None,
    device: str = "cpu",
    ball: float | None = None,
    scene: Path | None = None,
    backdrop: str | None = None,
    host: str = HOST,
    port: int = PORT,
    browser: bool = True,
) -> None:
    """Show the page for a fitted sequence, until Ctrl+C.

    Args:
        sequence: under `fits` in params.yaml.
        stage: whose model.
        beside: whether the twin without its named effects stands beside it.
        interval: whether the softest and the stiffest body that the fit leaves open are pulled along, for intervals of the forces.
        folder: gets a capture per pull; by default data/played/<sequence>.
        device: of the simulator.
        ball: radius of a ball to push with [m]; None for none.
        scene: mesh file of solids around the twin; None for none.
        backdrop: what is seen behind it, `filmed` or a file of splats; None for none.
        host: the address to listen on; only this machine reaches 127.0.0.1.
        port: of that address.
        browser: whether to open a browser here.

    Raises:
        InputError: viser is not installed, the port is taken, or `Twin.load` raises it.
    """
    if importlib.util.find_spec("viser") is None:
        raise InputError(
            "the page needs viser, which is not installed",
            where="physreal play",
            remedy='run `pip install "physreal[play]"`, in a checkout `pip install -e ".[play]"`',
        )
    project = Project.find()
    twin = Twin.load(project, sequence, stage, scene, backdrop)
    if beside and not twin.model.effects:
        raise InputError(
            f"the model of {sequence} has no named effect to leave out",
            where="physreal play --beside",
            remedy="play it alone, or another sequence",
        )
    require_free(host, port, "physreal play")
    import viser

    from applications.play.page import Page

    kinds = (True, False) if beside else (True,)
    sessions = [twin.session(device, effects=effects, ball=ball) for effects in kinds]
    ends = [Session(twin.problem, model, device, ball) for model in twin.ends(device)] if interval else []
    server = viser.ViserServer(host=host, port=port, label=f"PhysReal: {sequence}", verbose=False)
    page = Page(server, twin, sessions, folder or project.root / "data" / "played" / sequence, ends)
    page.loop.start()
    address = f"http://{host}:{port}"
    print(f"the twin of {sequence}: {address} (Ctrl+C ends it)", flush=True)
    if browser:
        webbrowser.open(address)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    ended.wait()
    page.close()
    server.stop()
