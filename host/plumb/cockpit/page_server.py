"""Serves the page and its WebSocket: on the loopback interface alone, to whoever knows the address.

An address has a random token. There are two: with one a page may take control, with the other it only watches. A
request needs the token in its path, the server's own name as Host, and a WebSocket the page's own Origin, so that
neither another page of the browser nor a name that was made to point here gets in. The page fetches nothing from
elsewhere.

Every page reads the rows at its own pace, and gets what is newest when it comes back: a slow page delays no other.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import itertools
import json
import logging
import secrets
import threading
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Protocol

from aiohttp import WSMsgType, web
from aiohttp.http_exceptions import HttpProcessingError

from plumb.cockpit import page_orders
from plumb.cockpit.arming import Answer, Reply
from plumb.cockpit.hold import Hold
from plumb.cockpit.page_orders import Order
from plumb.cockpit.samples import Samples
from plumb.errors import UsageError

HOST = "127.0.0.1"
PAGES_MAX = 16
PIECE_EVERY_S = 1 / 30
STATE_EVERY_S = 0.1
SEND_TIMEOUT_S = 10.0
"""A page that takes nothing for this long is closed."""
ANSWERS_KEPT = 100
MODULES = (
    "attitude", "cockpit", "columns", "control", "dom", "health", "light", "link", "panel", "parameters", "plots",
    "rows", "scale", "view",
)  # fmt: skip
ASSETS = {
    "": ("index.html", "text/html"),
    "cockpit.css": ("cockpit.css", "text/css"),
    **{f"{name}.js": (f"{name}.js", "text/javascript") for name in MODULES},
}
"""Path below the token -> file in the folder `page`, and its type."""
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}

REPORT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"
"""A report is a page by itself."""

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Served(Protocol):
    """The loop of a board or of a trip, which a page shows and gives orders to."""

    @property
    def hold(self) -> Hold: ...
    @property
    def samples(self) -> Samples | None: ...
    @property
    def state(self) -> Mapping[str, object]: ...
    @property
    def notes(self) -> deque[tuple[float, str]]: ...
    @property
    def reports(self) -> list[Path]:
        """Pages of records that are written."""

    def order(self, order: Order, reply: Reply, /) -> None: ...
    def stop(self) -> None: ...


class Speaks(Protocol):
    """An open page."""

    async def serve(self) -> None: ...


OpenPage = Callable[[web.WebSocketResponse, Callable[[], None], int, bool], Speaks]
"""Makes the page of a WebSocket: abort, its number, and whether it was opened with the address of control."""


def _logger() -> logging.Logger:
    """Of the server: it tells its own defects. A request that is no HTTP, or too long, is answered by 400 alone."""
    logger = logging.getLogger(__name__)
    if not logger.filters:
        logger.addFilter(lambda record: not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError)))
    return logger


class PageServer:
    """Serves one loop in a thread of its own. A context manager: leaving it closes every page.

    assets: the files of the page; opened: what speaks with an open one, None: the page of a board. control_address,
    watch_address: the two addresses. failed: the error that ended the thread, else None.
    """

    def __init__(
        self,
        loop: Served,
        port: int = 0,
        *,
        assets: Mapping[str, tuple[str, str]] = ASSETS,
        opened: OpenPage | None = None,
    ) -> None:
        self._board, self._port, self._assets = loop, port, assets
        self._opened = opened or (lambda socket, abort, number, control: Page(socket, abort, loop, number, control))
        self._control, self._watch = secrets.token_urlsafe(18), secrets.token_urlsafe(18)
        self._numbers = itertools.count(1)
        self._pages: set[web.WebSocketResponse] = set()
        self._ready = threading.Event()
        self._events: asyncio.AbstractEventLoop | None = None
        self._ending: asyncio.Event | None = None
        self._thread = threading.Thread(target=self._serve, name="page server", daemon=True)
        self.failed: BaseException | None = None

    @property
    def control_address(self) -> str:
        return f"http://{HOST}:{self._port}/{self._control}/"

    @property
    def watch_address(self) -> str:
        return f"http://{HOST}:{self._port}/{self._watch}/"

    def __enter__(self) -> PageServer:
        self._thread.start()
        self._ready.wait()
        if self.failed is not None:
            reason = self.failed.strerror if isinstance(self.failed, OSError) else str(self.failed)
            raise UsageError(f"port {self._port} cannot be served: {reason}; choose another with --port")
        return self

    def __exit__(self, *_: object) -> None:
        if self._events is not None and self._ending is not None and self._thread.is_alive():
            with contextlib.suppress(RuntimeError):  # it ended in between
                self._events.call_soon_threadsafe(self._ending.set)
        self._thread.join(timeout=2 * SEND_TIMEOUT_S)

    # ---- the server's thread ----

    def _serve(self) -> None:
        try:
            asyncio.run(self._main())
        except BaseException as error:
            self.failed = error
        finally:
            self._ready.set()

    async def _main(self) -> None:
        self._events, self._ending = asyncio.get_running_loop(), asyncio.Event()
        app = web.Application(middlewares=[self._guard])
        app.router.add_get("/{token}/live", self._live)
        app.router.add_get("/{token}/reports/{name}", self._report)
        app.router.add_get("/{token}/{asset:.*}", self._asset)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0, logger=_logger())
        await runner.setup()
        try:
            site = web.TCPSite(runner, HOST, self._port)
            await site.start()
            self._port = int(runner.addresses[0][1])
            self._ready.set()
            await self._ending.wait()
            for page in list(self._pages):
                await page.close(code=1001, message=b"plumb cockpit has ended")
        finally:
            await runner.cleanup()

    def _may_control(self, request: web.Request) -> bool | None:
        """Whether the address of a request is that of control; None: it is neither."""
        token = request.match_info.get("token", "").encode()
        control = hmac.compare_digest(token, self._control.encode())
        watch = hmac.compare_digest(token, self._watch.encode())
        return True if control else False if watch else None

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse what does not come from the page, and add the headers that keep the page by itself."""
        hosts = {f"{HOST}:{self._port}", f"localhost:{self._port}"}
        if request.host not in hosts:
            return web.Response(status=403, text="wrong Host\n", headers=HEADERS)
        if self._may_control(request) is None:
            return web.Response(status=403, text="wrong address: use the one that plumb printed\n", headers=HEADERS)
        answer = await handler(request)
        if not answer.prepared:
            answer.headers.update({**HEADERS, **answer.headers})
        return answer

    async def _asset(self, request: web.Request) -> web.Response:
        found = self._assets.get(request.match_info["asset"])
        if found is None:
            return web.Response(status=404, text="no such file\n")
        name, kind = found
        text = (Path(__file__).parent / "page" / name).read_text(encoding="utf-8")
        return web.Response(text=text, content_type=kind, charset="utf-8")

    async def _report(self, request: web.Request) -> web.Response:
        """A report that this loop has written; no other file."""
        found = next((path for path in self._board.reports if path.name == request.match_info["name"]), None)
        if found is None or not found.is_file():
            return web.Response(status=404, text="no such report\n")
        policy = {"Content-Security-Policy": REPORT_POLICY}
        return web.Response(body=found.read_bytes(), content_type="text/html", charset="utf-8", headers=policy)

    async def _live(self, request: web.Request) -> web.StreamResponse:
        if request.headers.get("Origin") != f"http://{request.host}":
            return web.Response(status=403, text="wrong Origin\n")
        if len(self._pages) >= PAGES_MAX:
            return web.Response(status=503, text=f"{PAGES_MAX} pages are open: close one\n")
        socket = web.WebSocketResponse(max_msg_size=4 * page_orders.MOST_BYTES, timeout=1.0, compress=False)
        await socket.prepare(request)
        self._pages.add(socket)
        transport = request.transport
        abort = transport.abort if transport is not None else lambda: None
        page = self._opened(socket, abort, next(self._numbers), self._may_control(request) is True)
        try:
            await page.serve()
        finally:
            self._pages.discard(socket)
        return socket


class Page:
    """One open page of a board. number: who it is to the Hold; control: opened with the address of control; abort: cuts
    its connection."""

    def __init__(
        self,
        socket: web.WebSocketResponse,
        abort: Callable[[], None],
        board: Served,
        number: int,
        control: bool,
    ) -> None:
        self._socket, self._abort, self._board = socket, abort, board
        self._number, self._control = number, control
        self._answers: deque[Answer] = deque(maxlen=ANSWERS_KEPT)
        self._run, self._row = 0, 0

    async def serve(self) -> None:
        """Send and receive until the page closes. The hold ends with it, whatever ended it."""
        if self._control:
            self._board.hold.take(self._number)
        sender = asyncio.create_task(self._send())
        try:
            async for message in self._socket:
                if message.type is WSMsgType.TEXT:
                    self._handle_message(message.data)
        finally:
            self._board.hold.release(self._number)
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError, TimeoutError):
                await sender

    # ---- to the page ----

    async def _send(self) -> None:
        """Rows 30 times a second, the state 10 times, answers at once. An await here is the page's own slowness."""
        events = asyncio.get_running_loop()
        state_s = 0.0
        try:
            while not self._socket.closed:
                begin_s = events.time()
                if begin_s - state_s >= STATE_EVERY_S:
                    state_s = begin_s
                    await self._text({"type": "state", **self._state()})
                while self._answers:
                    await self._text({"type": "answer", **self._answers.popleft()})
                await self._rows()
                await asyncio.sleep(max(0.0, PIECE_EVERY_S - (events.time() - begin_s)))
        except (ConnectionError, TimeoutError):
            self._abort()  # a close would wait for the page, too

    async def _text(self, said: dict[str, object]) -> None:
        await asyncio.wait_for(self._socket.send_str(json.dumps(said)), SEND_TIMEOUT_S)

    async def _rows(self) -> None:
        samples = self._board.samples
        if samples is None:
            return
        if samples.number != self._run:
            self._run, self._row = samples.number, max(0, samples.rows - samples.kept)
        piece, self._row = samples.piece(self._row, self._board.hold.next_tick())
        await asyncio.wait_for(self._socket.send_bytes(piece), SEND_TIMEOUT_S)

    def _state(self) -> dict[str, object]:
        hold = self._board.hold
        return {
            **self._board.state,
            "tick": hold.next_tick(),
            "may_control": self._control,
            "holds": hold.held_by(self._number),
            "held": hold.holder is not None,
            "notes": [[time_s, text] for time_s, text in list(self._board.notes)],
        }

    # ---- from the page ----

    def _handle_message(self, text: str) -> None:
        try:
            order = page_orders.parse(text, self._number)
        except UsageError as error:
            self._answers.append({"number": 0, "good": False, "text": str(error)})
            return
        if order.verb == page_orders.HEARTBEAT:
            self._board.hold.beat(self._number, order.tick)
            return

        def reply(answer: Answer) -> None:
            self._answers.append({"number": order.number, **answer})

        hold = self._board.hold
        if order.verb == page_orders.STOP:
            self._board.stop()
            reply({"good": True, "text": "stop"})
        elif not self._control:
            reply({"good": False, "text": "this page only watches: open the address of control"})
        elif order.verb == "take":
            taken = hold.take(self._number)
            reply({"good": taken, "text": "" if taken else "another page holds the board"})
        elif order.verb == "release":
            hold.release(self._number)
            reply({"good": True, "text": ""})
        elif not hold.held_by(self._number):
            reply({"good": False, "text": "this page does not hold the board: take control first"})
        else:
            self._board.order(order, reply)
