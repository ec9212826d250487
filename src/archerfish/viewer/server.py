"""The server of the page: viser's on loopback, behind a check of who asks, and without its tunnel to the outside.

A page of someone else, open in the same browser, can reach a server on loopback: by a websocket, which browsers let
cross from site to site, or under a name of its own that it makes point here (DNS rebinding). The first shows in the
Origin of its request, the second in its Host.
"""

import contextlib
import http
import inspect
import io
import socket
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import viser
import websockets.asyncio.server as transport

from archerfish.errors import InputError

LOOPBACK = "127.0.0.1"
HOSTS = (LOOPBACK, "localhost")
"""Under which the page may be asked for."""
CONTENT_POLICY = "default-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; frame-ancestors 'none'"
"""What the page may load: nothing from elsewhere; no other page may show it in a frame, to have it clicked unseen."""


@contextlib.contextmanager
def page_server(port: int) -> Iterator[Any]:
    """Serve on loopback while a block runs.

    Args:
      port: to listen on; any free one if 0.

    Raises:
      InputError: if the port can't be had.
    """
    check_port(port)
    served, silence = list[int](), contextlib.redirect_stdout(io.StringIO())  # viser prints on standard output
    with _guarded(served), silence:
        server: Any = viser.ViserServer(host=LOOPBACK, port=port, label="Archerfish", verbose=False)
        server.request_share_url = lambda **_: None  # any client could ask for the tunnel
    try:
        if not served:  # better no page than one without the check
            raise RuntimeError(f"viser {viser.__version__} does not serve through websockets, so it can't be guarded")
        server.gui.configure_theme(show_share_button=False)
        yield server
    finally:
        with silence:
            server.stop()


def check_port(port: int) -> None:
    """Refuse a port that is out of range or taken: viser would search on, or wait for ever.

    Raises:
      InputError: saying which.
    """
    if not 0 <= port < 2**16:
        raise InputError(f"--port must be 0…65535, got {port}; choose one of these")
    try:
        socket.create_server((LOOPBACK, port)).close()
    except OSError as error:
        remedy = "give another one from 1024 on, or 0 for any free one"
        raise InputError(f"--port {port} can't be had ({error.strerror}); {remedy}") from error


def refusal(hosts: Sequence[str], origins: Sequence[str]) -> str:
    """Say why a request is refused, "" if it is not.

    Args:
      hosts: its Host headers.
      origins: its Origin headers; programs that are no browser send none.
    """
    if len(hosts) != 1 or hosts[0].lower().partition(":")[0] not in HOSTS:
        return f"the page is not served under the name {', '.join(hosts) or '(none)'}"
    if len(origins) > 1 or any(origin.lower() != f"http://{hosts[0].lower()}" for origin in origins):
        return f"a page of {', '.join(origins)} may not use this one"
    return ""


@contextlib.contextmanager
def _guarded(served: list[int]) -> Iterator[None]:
    """Have every server that websockets starts in a block check who asks; `served` gets an item for each.

    viser has no hook for it: it takes `process_request` of websockets for its own files. So `serve` is wrapped.
    """
    serve = transport.serve

    def guarded_serve(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
        served.append(1)
        return serve(*arguments, process_request=_checked(process_request), **options)

    transport.serve = guarded_serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        transport.serve = serve  # type: ignore[misc]


def _checked(behind: Callable[[Any, Any], Any] | None) -> Callable[[Any, Any], Any]:
    async def process_request(connection: Any, request: Any) -> Any:
        if refused := refusal(request.headers.get_all("Host"), request.headers.get_all("Origin")):
            text = refused.encode("ascii", "backslashreplace").decode()
            return connection.respond(http.HTTPStatus.FORBIDDEN, f"archerfish: {text}\n")
        answer = behind(connection, request) if behind else None
        answer = await answer if inspect.isawaitable(answer) else answer
        if answer is not None:
            answer.headers["Content-Security-Policy"] = CONTENT_POLICY
        return answer

    return process_request
