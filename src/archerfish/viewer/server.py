"""The server of the page: viser's, on loopback, with a guard before it and no way to publish it."""

import contextlib
import http
import inspect
import io
import threading
from collections.abc import Callable, Iterator
from typing import Any

import viser
import websockets.asyncio.server as transport

from archerfish.viewer.guard import Allowed, allowed_hosts, check_bindable, refusal

_CONSTRUCTION = threading.Lock()


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
      InputError: if the host is not this machine's.
    """
    check_bindable(host)
    with _guarded(allowed_hosts(host)) as guards, quietly():
        server = PageServer(host=host, port=port, label=label, verbose=False)
    server.gui.configure_theme(show_share_button=False)
    if not guards:
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


@contextlib.contextmanager
def _guarded(allowed: Allowed) -> Iterator[list[str]]:
    """Put a guard before every server that viser starts in a block.

    viser has no hook for it: the one of websockets, `process_request`, it takes for its own files, and hands it to
    `serve` itself. So `serve` is wrapped while viser starts, and the guard asked before viser is.

    Yields:
      A list with an entry for each server that got a guard.
    """
    serve, guards = transport.serve, []

    def guarded_serve(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
        guards.append("serve")
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
            answer.headers["Content-Security-Policy"] = "frame-ancestors 'none'"
        return answer

    return process_request
