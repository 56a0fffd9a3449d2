"""Serves the page until it is ended."""

import importlib.util
import os
import socket

from physreal_core.errors import InputError
from pipeline.label.clip import Clip
from pipeline.project import Project

HOST, PORT = "127.0.0.1", 8765


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
    _require_free(host, port)
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(project.root / ".scratch" / "label"))
    from nicegui import ui

    from pipeline.label.page import build

    build(clip)
    print(f"the page of {sequence}: http://{host}:{port} (Ctrl+C ends it)", flush=True)
    ui.run(host=host, port=port, show=browser, reload=False, show_welcome_message=False)


def _require_free(host: str, port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise InputError(
                f"{host}:{port} cannot be listened on ({error.strerror})",
                where="physreal label",
                remedy="choose another port with --port",
            ) from None
