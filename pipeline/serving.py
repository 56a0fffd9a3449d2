"""What the pages that this package serves share."""

import socket

from physreal_core.errors import InputError


def require_free(host: str, port: int, command: str) -> None:
    """InputError where an address cannot be listened on, or something listens there already."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise InputError(
                f"{host}:{port} cannot be listened on ({error.strerror})",
                where=command,
                remedy="choose another port with --port",
            ) from None
