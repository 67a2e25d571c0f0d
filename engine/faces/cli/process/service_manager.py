"""What a service manager is told of a process: that a run has begun, and that it comes to rest."""

import os
import socket
from contextlib import suppress

NOTIFY_SOCKET = "NOTIFY_SOCKET"  # systemd.service(5): Type=notify


def notify_service(state: str) -> None:
    """Tell the service manager a state, such as `READY=1`, if there is one that listens."""
    address = os.environ.get(NOTIFY_SOCKET, "")
    if not address.startswith(("/", "@")) or not hasattr(socket, "AF_UNIX"):
        return
    place = "\0" + address[1:] if address.startswith("@") else address
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.setblocking(False)
        manager.sendto(state.encode(), place)
