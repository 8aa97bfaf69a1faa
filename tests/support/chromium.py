"""A headless Chromium for tests and pictures of pages, driven over its DevTools protocol."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Coroutine, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

import aiohttp

T = TypeVar("T")

NAMES = ("chromium", "chromium-browser", "google-chrome")
PATIENCE_S = 60.0
"""For everything that the browser is waited for; a test never passes by time."""
POLL_S = 0.05
SWITCHES = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-extensions", "--disable-sync", "--hide-scrollbars", "--mute-audio",
    "--disable-dev-shm-usage", "--remote-debugging-port=0", "--remote-allow-origins=*",
    "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)  # fmt: skip
"""Only the loopback interface can be reached. What draws in three dimensions is drawn without a GPU."""


def browser() -> str | None:
    """The path of a Chromium or Chrome, None without one."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Page:
    """A page in a window of its own."""

    def __init__(self, chromium: Chromium, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._chromium, self._socket, self._number = chromium, socket, 0

    def call(self, method: str, **parameters: object) -> Mapping[str, object]:
        """A call of the DevTools protocol; raises RuntimeError when the browser refuses it."""
        return self._chromium.wait(self._call(method, parameters))

    async def _call(self, method: str, parameters: Mapping[str, object]) -> Mapping[str, object]:
        self._number += 1
        await self._socket.send_str(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            said = json.loads(await self._socket.receive_str())
            if said.get("id") == self._number:
                if "error" in said:
                    raise RuntimeError(f"{method}: {said['error']}")
                return dict(said["result"])

    def value(self, expression: str) -> object:
        """The value of a JavaScript expression in the page."""
        said = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in said:
            raise RuntimeError(f"{expression}: {said['exceptionDetails']}")
        result = said["result"]
        assert isinstance(result, dict)
        return result.get("value")

    def load(self) -> None:
        """Wait until the page is there; on the way there it cannot be asked."""
        end_s = time.monotonic() + PATIENCE_S
        while True:
            with contextlib.suppress(RuntimeError):
                if self.value("location.href !== 'about:blank' && document.readyState === 'complete'"):
                    return
            assert time.monotonic() < end_s, "the page does not load"
            time.sleep(POLL_S)

    def until(self, expression: str, patience_s: float = PATIENCE_S) -> object:
        """Wait until the expression is true; its value."""
        end_s = time.monotonic() + patience_s
        while not (value := self.value(expression)):
            assert time.monotonic() < end_s, f"the page never came to: {expression}\n{self.text}"
            time.sleep(POLL_S)
        return value

    @property
    def text(self) -> str:
        return str(self.value("document.body.innerText"))

    def click(self, selector: str) -> None:
        self.until(f"document.querySelector({json.dumps(selector)})?.disabled === false")
        self.value(f"document.querySelector({json.dumps(selector)}).click()")

    def press(self, key: str) -> None:
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key)

    def close(self) -> None:
        """Close the window, as a person does; nothing if it is closed."""
        with contextlib.suppress(RuntimeError, TypeError, ConnectionError):
            self.call("Page.close")

    def picture(self, width: int, height: int) -> bytes:
        """The page in light colours as PNG, at a width and a height in pixels."""
        light = [{"name": "prefers-color-scheme", "value": "light"}]
        self.call("Emulation.setEmulatedMedia", features=light)
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        time.sleep(1.0)  # the plots are drawn anew for the new size
        return base64.b64decode(str(self.call("Page.captureScreenshot", format="png")["data"]))


class Chromium:
    """A browser with a profile of its own, which goes with it. process: of the browser."""

    def __init__(self) -> None:
        path = browser()
        assert path, f"none of {', '.join(NAMES)} is installed: tools/setup.sh test"
        self._loop = asyncio.new_event_loop()
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        command = [path, *SWITCHES, f"--user-data-dir={self._profile.name}", "about:blank"]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        port = self._port()
        self._client = self.wait(self._new_client())
        self._address = f"http://127.0.0.1:{port}"
        self._root = self.wait(self._socket_of("/json/version"))

    def _port(self) -> int:
        at, end_s = Path(self._profile.name) / "DevToolsActivePort", time.monotonic() + PATIENCE_S
        while True:
            with contextlib.suppress(OSError, IndexError, ValueError):
                return int(at.read_text(encoding="ascii").splitlines()[0])
            assert self.process.poll() is None and time.monotonic() < end_s, "the browser does not start"
            time.sleep(POLL_S)

    async def _new_client(self) -> aiohttp.ClientSession:
        return aiohttp.ClientSession()

    async def _socket_of(self, path: str) -> aiohttp.ClientWebSocketResponse:
        async with self._client.get(self._address + path) as answer:
            said = json.loads(await answer.text())
        return await self._connect(said["webSocketDebuggerUrl"])

    async def _connect(self, address: str) -> aiohttp.ClientWebSocketResponse:
        return await self._client.ws_connect(address, max_msg_size=0)

    def wait(self, job: Coroutine[object, object, T]) -> T:
        """The result of a job of the event loop."""
        return self._loop.run_until_complete(asyncio.wait_for(job, PATIENCE_S))

    def open(self, address: str) -> Page:
        """Open an address in a window of its own, so that no page hides another."""
        root = Page(self, self._root)
        target = root.call("Target.createTarget", url=address, newWindow=True)["targetId"]
        page = Page(self, self.wait(self._connect(f"{self._address}/devtools/page/{target}")))
        page.load()
        return page

    def kill(self) -> None:
        """End the browser as a crash does."""
        self.process.kill()
        self.process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.kill()
        self.wait(self._client.close())
        self._loop.close()
        self._profile.cleanup()
