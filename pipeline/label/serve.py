"""Serves the page until it is ended."""

import importlib.util
import os

from physreal_core.errors import InputError
from pipeline.label.clip import Clip
from pipeline.project import Project
from pipeline.serving import require_free

HOST, PORT = "127.0.0.1", 8765
LOCAL = (HOST, "localhost")
"""Names by which this machine alone, or the other end of a tunnel to it, is asked."""


def serve(sequence: str, *, host: str = HOST, port: int = PORT, browser: bool = True) -> None:
    """Show the page for a sequence, until Ctrl+C.

    Args:
        sequence: its name in params.yaml.
        host: the address to listen on; only this machine reaches 127.0.0.1.
        port: of that address.
        browser: whether to open a browser here.

    Raises:
        InputError: NiceGUI is not installed, the port is taken, there is no such sequence, or it has no frames.
    """
    if importlib.util.find_spec("nicegui") is None:
        raise InputError(
            "the page needs NiceGUI, which is not installed",
            where="physreal label",
            remedy='run `pip install "physreal[label]"`, in a checkout `pip install -e ".[label]"`',
        )
    project = Project.find()
    clip = Clip(project, sequence)
    require_free(host, port, "physreal label")
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(project.root / ".scratch" / "label"))
    from nicegui import app, ui
    from starlette.middleware.trustedhost import TrustedHostMiddleware

    from pipeline.label.page import build

    if host in LOCAL:  # a page elsewhere could have its own name lead to this address
        app.add_middleware(TrustedHostMiddleware, allowed_hosts=list(LOCAL))
    build(clip)
    print(f"the page of {sequence}: http://{host}:{port} (Ctrl+C ends it)", flush=True)
    ui.run(host=host, port=port, show=browser, reload=False, show_welcome_message=False)
