"""Who may talk to the page: a browser that shows the page itself, under a name of this machine, and nobody else.

A page of someone else's, open in the same browser, can reach a server on loopback: by a websocket, which browsers let
cross from site to site, or by a name of its own that is made to point here. Both show: the first in the Origin of its
request, the second in its Host.
"""

import ipaddress
import socket
from collections.abc import Sequence
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from archerfish.records.errors import InputError

LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})


class Allowed(NamedTuple):
    """Under which names the page may be asked for."""

    names: frozenset[str]
    """Host names and addresses, in lower case."""
    any_address: bool
    """Whether any numeric address will do: for a server on all interfaces. No name can be made to point to one."""


def allowed_hosts(host: str) -> Allowed:
    """Return under which names a server that is bound to `host` may be asked for."""
    if is_loopback(host):
        return Allowed(LOOPBACK_NAMES | {host.lower()}, any_address=False)
    names = LOOPBACK_NAMES | {host.lower(), socket.gethostname().lower()}
    return Allowed(names, any_address=host in ("", "0.0.0.0", "::"))


def is_loopback(host: str) -> bool:
    """Whether every address of a host is this machine's own loopback.

    Raises:
      InputError: if the host has no address.
    """
    return all(ipaddress.ip_address(each).is_loopback for each in addresses(host))


def addresses(host: str) -> list[str]:
    """Return the addresses that a host to listen on stands for.

    Raises:
      InputError: if it has none.
    """
    return [str(place[0]).partition("%")[0] for _, place in places(host)]


def check_bindable(host: str) -> None:
    """Refuse a host that this machine can't listen on.

    Raises:
      InputError: if it is not this machine's.
    """
    for family, place in places(host):
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            try:
                probe.bind(place)
            except OSError as error:
                raise _not_ours(host, error) from error


def places(host: str) -> list[tuple[int, Any]]:
    """Return family and socket address of everything that a host to listen on stands for.

    Raises:
      InputError: if it has no address.
    """
    try:
        found = socket.getaddrinfo(host or None, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as error:
        raise _not_ours(host, error) from error
    return [(each[0], each[4]) for each in found]


def _not_ours(host: str, error: Exception) -> InputError:
    return InputError(f"--host must be an address of this machine, got {host!r} ({error}); try 127.0.0.1")


def refusal(hosts: Sequence[str], origins: Sequence[str], allowed: Allowed) -> str:
    """Say why a request is refused; empty if it is not.

    Args:
      hosts: its Host headers.
      origins: its Origin headers; programs that are no browser send none.
      allowed: under which names it may come.
    """
    if len(hosts) != 1 or not _is_ours(hosts[0], allowed):
        return f"this page is not to be had under the name {', '.join(hosts) or '(none)'}"
    if len(origins) > 1 or any(origin.lower() != f"http://{hosts[0].lower()}" for origin in origins):
        return f"a page of {', '.join(origins)} may not talk to this one"
    return ""


def _is_ours(host: str, allowed: Allowed) -> bool:
    try:
        name, _ = urlsplit(f"//{host}").hostname or "", urlsplit(f"//{host}").port
    except ValueError:
        return False
    if "@" in host or "/" in host:
        return False
    return name in allowed.names or (allowed.any_address and _is_address(name))


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
