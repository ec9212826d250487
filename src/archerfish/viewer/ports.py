"""A free port to listen on, found before viser looks for one: it waits for ever where there is none."""

import errno
import socket
from collections.abc import Sequence
from typing import Any

from archerfish.records.errors import InputError

LAST_PORT = 2**16 - 1


def free_port(places: Sequence[tuple[int, tuple[Any, ...]]], port: int) -> int:
    """Return the first port from `port` on that is free at all addresses; 0, which is any, as it stands.

    Args:
      places: families and addresses of the host, as `socket.getaddrinfo` gives them.
      port: the wanted one.

    Raises:
      InputError: if there is none, or this user may not listen on it.
    """
    if not 0 <= port <= LAST_PORT:
        raise InputError(f"--port must be within 0…{LAST_PORT}, got {port}")
    if port == 0:
        return 0
    for wanted in range(port, LAST_PORT + 1):
        if all(_is_free(family, place, wanted) for family, place in places):
            return wanted
    taken = f"{port} is" if port == LAST_PORT else f"all of {port}…{LAST_PORT} are"
    raise InputError(f"--port must be free, but {taken} taken; pass a lower one, or 0 for any")


def _is_free(family: int, place: tuple[Any, ...], port: int) -> bool:
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        # As the server does: a port whose last connections are still closing is free.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            probe.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        try:
            probe.bind((place[0], port, *place[2:]))
            probe.listen(1)
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                return False
            if error.errno in (errno.EACCES, errno.EPERM):
                problem = f"--port must be one that this user may listen on, got {port} ({error.strerror})"
                raise InputError(f"{problem}; pass one from 1024 on") from error
            raise InputError(f"can't listen on port {port} ({error}); pass another --port or --host") from error
    return True
