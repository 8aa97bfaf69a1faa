"""The server of the page: who gets in, what a page may order, and a page that reads nothing."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import TypeVar

import aiohttp
import pytest

from plumb.cockpit import page_server
from plumb.cockpit.page_server import ASSETS, PAGES_MAX, PageServer
from plumb.errors import UsageError
from support.cockpit_bench import CockpitBench, serving

T = TypeVar("T")
PATIENCE_S = 30.0


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PageServer]:
    """A server of a board whose loop runs in real time; the hold's clock stands still: a test that is slow disarms
    nothing."""
    with serving(CockpitBench(tmp_path, paced=True).loop) as server:
        yield server


def asked(job: Callable[[aiohttp.ClientSession], Awaitable[T]]) -> T:
    async def run() -> T:
        async with aiohttp.ClientSession() as client:
            return await asyncio.wait_for(job(client), PATIENCE_S)

    return asyncio.run(run())


def origin_of(address: str) -> str:
    return "/".join(address.split("/")[:3])


class OpenPage:
    """A page's end of the WebSocket."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self.socket = socket

    async def said(self, kind: str) -> dict[str, object]:
        """The next message of that type."""
        while True:
            message = await self.socket.receive()
            assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY), message
            if message.type is aiohttp.WSMsgType.TEXT and (said := json.loads(message.data))["type"] == kind:
                return dict(said)

    async def order(self, verb: str, **more: object) -> dict[str, object]:
        await self.socket.send_json({"do": verb, "number": 1, **more})
        return await self.said("answer")

    async def until(self, **state: object) -> dict[str, object]:
        """The first state with these values."""
        while True:
            said = await self.said("state")
            if all(said.get(name) == value for name, value in state.items()):
                return said


async def opened(client: aiohttp.ClientSession, address: str) -> OpenPage:
    return OpenPage(await client.ws_connect(f"{address}live", headers={"Origin": origin_of(address)}))


def test_every_file_of_the_page_is_served_and_fetches_nothing_from_elsewhere(server: PageServer) -> None:
    async def job(client: aiohttp.ClientSession) -> None:
        for name, (_, kind) in ASSETS.items():
            async with client.get(server.watch_address + name) as answer:
                assert (answer.status, answer.content_type) == (200, kind)
                assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
                text = await answer.text()
                assert "http://" not in text.replace("http://www.w3.org", "") and "https://" not in text

    asked(job)


def test_every_file_of_the_folder_is_served() -> None:
    folder = Path(page_server.__file__).parent / "page"
    assert {name for name, _ in ASSETS.values()} == {path.name for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("path", ["", "wrong/", "wrong/live", "../", "%2e%2e/"])
def test_without_the_token_nothing_is_served(server: PageServer, path: str) -> None:
    async def job(client: aiohttp.ClientSession) -> int:
        address = origin_of(server.control_address)
        async with client.get(f"{address}/{path}", headers={"Origin": address}) as answer:
            assert "plumb cockpit" not in await answer.text()
            return answer.status

    assert asked(job) in (403, 404)


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:{port}"])
def test_another_name_of_this_machine_gets_nothing(server: PageServer, host: str) -> None:
    port = server.control_address.split("/")[2].split(":")[1]

    async def job(client: aiohttp.ClientSession) -> int:
        async with client.get(server.control_address, headers={"Host": host.format(port=port)}) as answer:
            return answer.status

    assert asked(job) == 403


@pytest.mark.parametrize("origin", [None, "null", "http://evil.example", "http://127.0.0.1:1", "https://{host}"])
def test_a_socket_of_another_page_is_refused(server: PageServer, origin: str | None) -> None:
    host = server.control_address.split("/")[2]
    headers = {} if origin is None else {"Origin": origin.format(host=host)}

    async def job(client: aiohttp.ClientSession) -> int:
        try:
            await client.ws_connect(f"{server.control_address}live", headers=headers)
        except aiohttp.WSServerHandshakeError as refused:
            return refused.status
        return 101

    assert asked(job) == 403


def test_no_file_outside_the_page_is_served(server: PageServer) -> None:
    async def job(client: aiohttp.ClientSession) -> None:
        for name in ("../hold.py", "%2e%2e%2fhold.py", "hold.py", "/etc/passwd", "index.html"):
            async with client.get(server.control_address + name) as answer:
                assert answer.status in (403, 404), name

    asked(job)


def test_the_first_page_of_control_holds_the_board_and_others_watch(server: PageServer) -> None:
    async def job(client: aiohttp.ClientSession) -> None:
        first, second = await opened(client, server.control_address), await opened(client, server.control_address)
        viewer = await opened(client, server.watch_address)
        assert (await first.until(holds=True))["may_control"]
        assert not (await second.until(held=True))["holds"]
        for page in (second, viewer):
            for verb in ("arm", "run", "record", "parameters", "save"):
                assert not (await page.order(verb, on=True))["good"]
        assert not (await second.order("take"))["good"]
        assert not (await viewer.order("take"))["good"]
        await first.socket.close()
        await second.until(held=False)
        assert not (await viewer.order("take"))["good"]
        assert (await second.order("take"))["good"]

    asked(job)


async def armed_page(client: aiohttp.ClientSession, address: str) -> OpenPage:
    page = await opened(client, address)
    await page.until(holds=True, own_run=True)
    for _ in range(50):
        if (await page.order("arm"))["good"]:
            break
    await page.until(armed_here=True)
    return page


def test_a_page_that_closes_while_armed_disarms(server: PageServer) -> None:
    async def job(client: aiohttp.ClientSession) -> None:
        viewer = await opened(client, server.watch_address)
        page = await armed_page(client, server.control_address)
        await viewer.until(armed=True)
        await page.socket.close()
        said = await viewer.until(armed=False)
        assert any("fell silent" in text for _, text in said["notes"])  # type: ignore[attr-defined]

    asked(job)


def test_a_viewer_stops_an_armed_board(server: PageServer) -> None:
    async def job(client: aiohttp.ClientSession) -> None:
        page = await armed_page(client, server.control_address)
        viewer = await opened(client, server.watch_address)
        assert (await viewer.order("stop"))["good"]
        await page.until(armed=False)

    asked(job)


def test_garbage_from_a_page_is_answered_and_the_page_goes_on(server: PageServer) -> None:
    async def job(client: aiohttp.ClientSession) -> None:
        page = await opened(client, server.control_address)
        for text in ("", "{", "[]", '{"do": "fly"}', '{"do": "setpoint", "value": NaN}'):
            await page.socket.send_str(text)
            assert not (await page.said("answer"))["good"]
        await page.socket.send_bytes(b"\x00\xff")
        await page.until(holds=True)

    asked(job)


def test_a_hostile_viewer_takes_nothing_from_the_page_that_armed(server: PageServer) -> None:
    """It floods the server with junk, with orders and heartbeats that are not its to give, and with a huge message."""

    async def job(client: aiohttp.ClientSession) -> None:
        page = await armed_page(client, server.control_address)
        hostile = await opened(client, server.watch_address)
        for number in range(200):
            await hostile.socket.send_json({"do": "alive", "tick": number})
            await hostile.socket.send_str('{"do": "set", "name": "pid.kp", "value": 1e9}')
            await hostile.socket.send_str("[" * 1000)
            await hostile.socket.send_bytes(b"\xff" * 1000)
        assert not (await hostile.order("arm"))["good"]
        await hostile.socket.send_str("x" * 1_000_000)
        while not hostile.socket.closed:
            await hostile.socket.receive()
        said = await page.until(armed_here=True)
        assert said["holds"] and (await page.order("record", on=False))["good"]

    asked(job)


def test_a_page_that_lost_its_hold_orders_nothing_any_more(server: PageServer) -> None:
    async def job(client: aiohttp.ClientSession) -> None:
        first = await opened(client, server.control_address)
        await first.until(holds=True)
        second = await opened(client, server.control_address)
        assert (await first.order("release"))["good"]
        assert (await second.order("take"))["good"]
        for verb in ("arm", "run", "record", "save", "release"):
            said = await first.order(verb, on=True)
            assert verb == "release" or not said["good"], verb
        assert (await second.until(held=True))["holds"]

    asked(job)


def deaf_page(address: str) -> socket.socket:
    """A page that opens its socket, and never reads from it."""
    host, port = address.split("/")[2].split(":")
    deaf = socket.socket()
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    deaf.connect((host, int(port)))
    origin = origin_of(address)
    deaf.sendall(
        f"GET {address[len(origin) :]}live HTTP/1.1\r\nHost: {host}:{port}\r\nOrigin: {origin}\r\n"
        "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
    )
    return deaf


def test_a_page_that_reads_nothing_delays_no_other(server: PageServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is closed when its end takes nothing; the others see the newest rows meanwhile."""
    monkeypatch.setattr(page_server, "SEND_TIMEOUT_S", 0.5)
    monkeypatch.setattr(page_server, "PIECE_EVERY_S", 0.001)
    monkeypatch.setattr(page_server, "STATE_EVERY_S", 0.0)

    async def job(client: aiohttp.ClientSession) -> None:
        address = server.watch_address
        deaf = deaf_page(address)
        other = await opened(client, address)
        first = await other.until(own_run=True)
        assert len(server._pages) == 2
        while len(server._pages) > 1:
            said = await other.said("state")
        assert said["health"]["time_s"] > first["health"]["time_s"]  # type: ignore[index]
        deaf.close()

    asked(job)


def test_pages_have_a_limit(server: PageServer) -> None:
    async def job(client: aiohttp.ClientSession) -> None:
        pages = [await opened(client, server.watch_address) for _ in range(PAGES_MAX)]
        with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
            await opened(client, server.watch_address)
        await pages[0].socket.close()

    asked(job)


def test_a_port_that_is_taken_is_one_sentence(server: PageServer, tmp_path: Path) -> None:
    port = int(server.control_address.split("/")[2].split(":")[1])
    with pytest.raises(UsageError, match=f"port {port} cannot be served"), PageServer(server._board, port):
        pass


def test_a_header_that_is_too_long_is_refused_without_a_traceback(
    server: PageServer, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    port = int(server.control_address.split(":")[2].split("/")[0])
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as line:
        line.sendall(b"GET / HTTP/1.1\r\nHost: x\r\nX-Long: " + b"a" * 200_000 + b"\r\n\r\n")
        assert b" 400 " in line.recv(100)
    assert asked(lambda client: fetched(client, server.control_address)) == 200
    assert caplog.records == [] and "Traceback" not in capfd.readouterr().err


async def fetched(client: aiohttp.ClientSession, address: str) -> int:
    async with client.get(address) as answer:
        return answer.status
