"""The server of the page: viser's, on loopback, with guards before it and no way to publish it."""

import contextlib
import http
import inspect
import io
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import viser
import websockets.asyncio.server as transport

from archerfish.viewer.guard import Allowed, allowed_hosts, check_bindable, places, refusal
from archerfish.viewer.messages import LONGEST_BYTES, is_acceptable
from archerfish.viewer.ports import free_port

_CONSTRUCTION = threading.Lock()
POLICY = "; ".join(
    (
        "default-src 'none'",
        # viser's client is one file that unpacks itself: script, styles, fonts, the decoder of its messages.
        "script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:",
        "worker-src 'self' blob: data:",
        "style-src 'self' 'unsafe-inline' blob: data:",
        "font-src 'self' blob: data:",
        "img-src 'self' blob: data:",
        "connect-src 'self' blob: data:",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
"""What the page may load, and from where: nothing from elsewhere, no frames, no plug-ins."""


class PageServer(viser.ViserServer):
    """viser's server without its tunnel to the outside, which any client could ask for."""

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: ARG002
        """Publish nothing."""
        return None


def open_server(host: str, port: int, label: str) -> PageServer:
    """Start the server.

    Args:
      host: to listen on.
      port: to listen on; the next free one if it is taken, any if 0.
      label: title of the page.

    Raises:
      InputError: if the host is not this machine's, or no port is free.
    """
    check_bindable(host)
    port = free_port(places(host), port)
    with _guarded(allowed_hosts(host)) as guards, quietly():
        server = PageServer(host=host, port=port, label=label, verbose=False)
    server.gui.configure_theme(show_share_button=False)
    controls = getattr(server.gui, "_gui_input_handle_from_uuid", None)
    if controls is not None:
        guards.controls = controls
    if not guards.serving or controls is None:
        # Another viser may serve in another way: better no page than one without a guard.
        close_server(server)
        raise RuntimeError(f"viser {viser.__version__} does not serve through websockets, so it can't be guarded")
    return server


def close_server(server: PageServer) -> None:
    """Stop the server."""
    with quietly():
        server.stop()


@contextlib.contextmanager
def quietly() -> Iterator[None]:
    """Keep what viser prints of itself from standard output, which belongs to the command line."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield


class _Guards:
    """What is known of the servers that viser started."""

    def __init__(self) -> None:
        self.serving = False
        self.controls: Mapping[str, Any] = {}


@contextlib.contextmanager
def _guarded(allowed: Allowed) -> Iterator[_Guards]:
    """Put guards before every server that viser starts in a block: of requests, and of messages.

    viser has no hook for it: the one of websockets, `process_request`, it takes for its own files, and hands it to
    `serve` itself. So `serve` is wrapped while viser starts, and the guards asked before viser is.

    Yields:
      Whether a server got guards; it is to be told of the controls, of which no message passes before.
    """
    serve, guards = transport.serve, _Guards()

    class Sifted(transport.ServerConnection):
        async def recv(self, decode: bool | None = None) -> Any:
            while not is_acceptable(raw := await super().recv(decode), guards.controls.get):
                pass
            return raw

    def guarded_serve(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
        guards.serving = True
        options |= {"create_connection": Sifted, "max_size": LONGEST_BYTES}
        return serve(*arguments, process_request=_guard(allowed, process_request), **options)

    with _CONSTRUCTION:
        transport.serve = guarded_serve  # type: ignore[assignment, misc]
        try:
            yield guards
        finally:
            transport.serve = serve  # type: ignore[misc]


def _guard(allowed: Allowed, behind: Callable[[Any, Any], Any] | None) -> Callable[[Any, Any], Any]:
    async def process_request(connection: Any, request: Any) -> Any:
        refused = refusal(request.headers.get_all("Host"), request.headers.get_all("Origin"), allowed)
        if refused:
            # What is no ASCII could not be sent back.
            told = refused.encode("ascii", "backslashreplace").decode()
            return connection.respond(http.HTTPStatus.FORBIDDEN, f"archerfish: {told}\n")
        answer = None if behind is None else behind(connection, request)
        answer = await answer if inspect.isawaitable(answer) else answer
        if answer is not None:
            # No other page may show this one in a frame of its own, to have it clicked unseen.
            answer.headers["X-Frame-Options"] = "DENY"
            answer.headers["Content-Security-Policy"] = POLICY
        return answer

    return process_request
