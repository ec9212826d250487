import base64
import contextlib
import errno
import http.client
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from archerfish.records.errors import InputError
from archerfish.viewer.guard import allowed_hosts, is_loopback, places, refusal
from archerfish.viewer.ports import LAST_PORT, free_port

OURS = allowed_hosts("127.0.0.1")


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    pytest.importorskip("viser")
    from archerfish.viewer.server import close_server, open_server

    server = open_server("127.0.0.1", 0, "test")
    yield server.get_port()
    close_server(server)


def answer(port: int, path: str = "/", **headers: str) -> tuple[int, bytes]:
    """Send a request with these headers alone; return status and content."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.putrequest("GET", path, skip_host=True, skip_accept_encoding=True)
    for name, value in headers.items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders()
    response = connection.getresponse()
    content = response.read() if response.status != 101 else b""
    connection.close()
    return response.status, content


def handshake(port: int, **headers: str) -> int:
    """Ask for a websocket; return the status."""
    key = base64.b64encode(bytes(16)).decode()
    wanted = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Key": key, "Sec_WebSocket_Version": "13"}
    return answer(port, **wanted, **headers)[0]


def test_the_page_is_served_under_its_own_name(port: int) -> None:
    for name in ("127.0.0.1", "localhost"):
        status, content = answer(port, Host=f"{name}:{port}")
        assert status == 200
        assert b"<html" in content


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "localhost@evil.example", "", "192.0.2.7"])
def test_a_foreign_host_is_refused(port: int, host: str) -> None:
    status, content = answer(port, Host=f"{host}:{port}" if host else "")
    assert status == 403
    assert b"<html" not in content
    assert handshake(port, Host=f"{host}:{port}" if host else "") == 403


def test_no_other_page_may_frame_this_one(port: int) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("GET", "/")
    response = connection.getresponse()
    assert response.headers["X-Frame-Options"] == "DENY"
    policy = response.headers["Content-Security-Policy"].split("; ")
    assert "frame-ancestors 'none'" in policy
    assert "default-src 'none'" in policy
    assert not any("http" in each or "*" in each for each in policy)
    connection.close()


def test_a_host_that_is_no_ascii_is_refused(port: int) -> None:
    for host in (b"\xc3\xa9vil.example", b"\xff"):
        with socket.create_connection(("127.0.0.1", port), timeout=10) as there:
            there.sendall(b"GET / HTTP/1.1\r\nHost: " + host + b"\r\n\r\n")
            assert there.recv(100).split()[1] == b"403"


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://localhost:1", "https://127.0.0.1:{port}", "file://"]
)
def test_a_foreign_origin_is_refused(port: int, origin: str) -> None:
    headers = {"Host": f"127.0.0.1:{port}", "Origin": origin.format(port=port)}
    assert handshake(port, **headers) == 403
    assert answer(port, **headers)[0] == 403


def test_the_page_itself_may_open_its_websocket(port: int) -> None:
    assert handshake(port, Host=f"127.0.0.1:{port}", Origin=f"http://127.0.0.1:{port}") == 101


def test_only_the_client_is_served_of_all_files(port: int) -> None:
    for path in ("/../../../../../../etc/passwd", "/%2e%2e/%2e%2e/%2e%2e/_viser.py", "//etc/passwd"):
        assert answer(port, path, Host=f"127.0.0.1:{port}")[0] in (400, 404)


def test_nothing_listens_beyond_loopback(port: int) -> None:
    table = Path("/proc/net/tcp")
    if not table.is_file():
        pytest.skip("needs /proc/net/tcp, the list of listening sockets")
    rows = [line.split() for each in ("tcp", "tcp6") for line in (table.parent / each).read_text().splitlines()[1:]]
    listening = [row[1].split(":") for row in rows if row[3] == "0A"]
    assert [address for address, there in listening if int(there, 16) == port] == ["0100007F"]


def test_nobody_can_have_the_page_published(port: int) -> None:
    from archerfish.viewer.server import PageServer

    assert PageServer.request_share_url(None) is None  # type: ignore[arg-type]


def test_a_server_on_all_interfaces_takes_addresses_and_no_foreign_names() -> None:
    allowed = allowed_hosts("0.0.0.0")
    assert not refusal(["192.0.2.7:8080"], ["http://192.0.2.7:8080"], allowed)
    assert not refusal([f"{socket.gethostname()}:8080"], [], allowed)
    assert refusal(["evil.example:8080"], [], allowed)
    assert refusal(["192.0.2.7:8080"], ["http://evil.example"], allowed)


def test_hosts_and_origins_that_are_doubled_or_mangled_are_refused() -> None:
    assert not refusal(["localhost:80"], ["http://LOCALHOST:80"], OURS)
    assert not refusal(["[::1]:80"], ["http://[::1]:80"], OURS)
    for hosts in ([], ["localhost", "localhost"], ["localhost:x"], ["[::1"], ["localhost/evil"], ["192.0.2.7"]):
        assert refusal(hosts, [], OURS)
    assert refusal(["localhost"], ["http://localhost", "http://localhost"], OURS)


def test_hosts_are_told_apart() -> None:
    assert is_loopback("127.0.0.1")
    assert is_loopback("::1")
    assert not is_loopback("0.0.0.0")
    with pytest.raises(InputError, match="--host"):
        is_loopback("no such host")


def test_a_host_of_another_machine_is_refused() -> None:
    pytest.importorskip("viser")
    from archerfish.viewer.server import open_server

    with pytest.raises(InputError, match="--host"):
        open_server("192.0.2.7", 0, "test")


def test_a_taken_port_gives_way_to_the_next_and_the_last_one_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as first:
        taken = first.getsockname()[1]
        assert taken < free_port(places("127.0.0.1"), taken) <= LAST_PORT
    assert free_port(places("127.0.0.1"), taken) == taken
    assert free_port(places("127.0.0.1"), 0) == 0
    with contextlib.ExitStack() as stack:
        # Somebody else may have it already.
        with contextlib.suppress(OSError):
            stack.enter_context(socket.create_server(("127.0.0.1", LAST_PORT)))
        with pytest.raises(InputError, match="--port must be free, but 65535 is taken"):
            free_port(places("127.0.0.1"), LAST_PORT)
    with pytest.raises(InputError, match="within 0…65535, got 65536"):
        free_port(places("127.0.0.1"), LAST_PORT + 1)


def test_a_port_that_this_user_may_not_have_is_told_from_a_taken_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    with pytest.raises(InputError, match=r"may listen on, got 80 \(Permission denied\)"):
        free_port([(socket.AF_INET, ("127.0.0.1", 0))], 80)


def test_a_viser_that_serves_in_another_way_is_not_left_unguarded(monkeypatch: pytest.MonkeyPatch) -> None:
    viser_infra = pytest.importorskip("viser.infra._infra")
    from archerfish.viewer import server

    class Elsewhere:
        asyncio = type("asyncio", (), {"server": type("server", (), {"serve": server.transport.serve})})

        def __getattr__(self, name: str) -> object:
            return getattr(original, name)

    original = viser_infra.websockets
    monkeypatch.setattr(viser_infra, "websockets", Elsewhere())
    with pytest.raises(RuntimeError, match="guarded"):
        server.open_server("127.0.0.1", 0, "test")
