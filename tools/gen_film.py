"""Write docs/images/flight.webp: what `plumb fly` and `plumb ride` show of the scenes in tools/films.

    .venv/bin/python tools/gen_film.py [SCENE ...]

Needs Chromium or Chrome, and Pillow. A gamepad of the page steers by the script of a scene. Board, page and pictures
run at a share of real time, so that a machine without a GPU draws every picture; the film runs at the vehicle's speed.
"""

from __future__ import annotations

import base64
import io
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

from plumb.cockpit.hold import Hold
from plumb.cockpit.speed import Pace
from plumb.cockpit.steering import transmitter
from plumb.cockpit.steering.trip_loop import TripLoop

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from PIL import Image  # noqa: E402

from support.chromium import Chromium, Page, browser  # noqa: E402
from support.trip_bench import steering  # noqa: E402

FILMS, FILM = ROOT / "tools" / "films", ROOT / "docs" / "images" / "flight.webp"
MOST_BYTES = 3_000_000
DRAWN, SIZE = (1120, 630), (896, 504)
"""Pixels of the page, and of the film."""
PICTURES_PER_S, LAST_S = 12, 1.5
SHARE = 0.12
"""Of real time."""
QUALITIES = (60, 55, 50, 45, 40, 35)
"""Of the pictures, the best that fits first."""
HOLD_S, PATIENCE_S = 600.0, 300.0
BUTTONS = {"motors": 0, "mode": 1, "height": 3}
AXES = {"yaw": (0, -1), "up": (1, -1), "roll": (2, 1), "pitch": (3, -1)}
"""As hands.js reads them: place and sign."""
PRESSED_S = 0.05
SCRIPT = """
  const real = performance.now.bind(performance), begun = real(), draw = window.requestAnimationFrame.bind(window);
  performance.now = () => begun + (real() - begun) * SHARE;
  window.requestAnimationFrame = (then) => draw(() => then(performance.now()));
  window.pad = { id: "scripted", connected: true, axes: [0, 0, 0, 0],
    buttons: Array.from({ length: 12 }, () => ({ pressed: false })) };
  navigator.getGamepads = () => [window.pad];
"""
SHARP = "import('./scene.js').then(({ Scene }) => { Scene.prototype.judge = () => {}; })"
"""A machine that draws slowly keeps all its pixels."""
HIDDEN = ("rate", "log", "gamepad", "new")
"""What does not belong to the film."""


@dataclass(frozen=True)
class Move:
    """What the hands do at a time of the scene."""

    at_s: float
    axes: dict[str, float] | None = None
    press: str = ""
    click: str = ""


@dataclass(frozen=True)
class Scene:
    """A file of tools/films."""

    order: int
    system: str
    seed: int
    seconds: float
    moves: tuple[Move, ...]


def scene_of(path: Path) -> Scene:
    said = tomllib.loads(path.read_text(encoding="utf-8"))
    return Scene(**{**said, "moves": tuple(Move(**move) for move in said["moves"])})


class SlowPace(Pace):
    """Holds a trip back to a share of real time."""

    def keep(self, now_s: float, _most_s: float) -> None:
        ahead_s = (now_s - self._begin_s) / SHARE - (time.monotonic() - self._begin_wall_s)
        time.sleep(max(0.0, ahead_s))


class SlowTrip(TripLoop):
    def begin(self) -> None:
        super().begin()
        self._pace = SlowPace(self._begun_s)

    @property
    def time_s(self) -> float:
        now_s = self.scene.get("time_s", 0.0)
        assert isinstance(now_s, float | int)
        return float(now_s)

    def until(self, time_s: float) -> None:
        while self.time_s < time_s:
            time.sleep(0.005)


def filmed(scene: Scene) -> list[Image.Image]:
    """The pictures of a scene."""
    transmitter.LOST_S = HOLD_S  # a picture takes longer than a pilot's receiver waits
    pictures = []
    with tempfile.TemporaryDirectory() as folder, Chromium() as chromium:
        loop = SlowTrip(scene.system, scene.seed, Hold(HOLD_S), folder=Path(folder))
        with steering(loop) as server:
            page = chromium.open(server.watch_address)
            page.call("Page.enable")
            page.call("Page.addScriptToEvaluateOnNewDocument", source=SCRIPT.replace("SHARE", str(SHARE)))
            light = [{"name": "prefers-color-scheme", "value": "light"}]
            page.call("Emulation.setEmulatedMedia", features=light)
            width, height = DRAWN
            page.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
            page.call("Page.navigate", url=server.control_address)
            page.load()
            page.value(SHARP)
            page.until("document.getElementById('hint').textContent.includes('Enter')", patience_s=PATIENCE_S)
            for name in HIDDEN:
                page.value(f"document.getElementById('{name}').style.display = 'none'")
            begin_s, moves = loop.time_s, list(scene.moves)
            for number in range(round(scene.seconds * PICTURES_PER_S)):
                at_s = number / PICTURES_PER_S
                while moves and moves[0].at_s <= at_s:
                    loop.until(begin_s + moves[0].at_s)
                    do(page, loop, moves.pop(0))
                loop.until(begin_s + at_s)
                pictures.append(picture(page))
                print(f"\r{scene.system}: {at_s:.1f} s, {loop.time_s - begin_s - at_s:+.2f} s", end="", flush=True)
    print()
    return pictures


def do(page: Page, loop: SlowTrip, move: Move) -> None:
    if move.axes is not None:
        values = [0.0] * 4
        for name, value in move.axes.items():
            place, sign = AXES[name]
            values[place] = sign * value
        page.value(f"pad.axes = {values}")
    if move.press:
        button = f"pad.buttons[{BUTTONS[move.press]}].pressed"
        page.value(f"{button} = true")
        loop.until(loop.time_s + PRESSED_S)
        page.value(f"{button} = false")
    if move.click:
        page.click(f"aside [data-event={move.click}], #legend [data-ghost={move.click}]")


def picture(page: Page) -> Image.Image:
    taken = page.call("Page.captureScreenshot", format="png", optimizeForSpeed=True)
    image = Image.open(io.BytesIO(base64.b64decode(str(taken["data"])))).convert("RGB")
    return image.resize(SIZE, Image.Resampling.LANCZOS)


def write(pictures: list[Image.Image], path: Path) -> int:
    """The film in the best quality that fits; its bytes."""
    each_ms = round(1000 / PICTURES_PER_S)
    durations = [*(each_ms,) * (len(pictures) - 1), each_ms + round(1000 * LAST_S)]
    for quality in QUALITIES:
        film = io.BytesIO()
        pictures[0].save(
            film, "WEBP", save_all=True, append_images=pictures[1:], duration=durations, loop=0, quality=quality,
            method=4, minimize_size=False, kmin=3, kmax=5,
        )  # fmt: skip
        size = film.tell()
        print(f"quality {quality}: {size} bytes")
        if size <= MOST_BYTES:
            path.write_bytes(film.getvalue())
            return size
    raise SystemExit(f"gen_film: {path.name} has more than {MOST_BYTES} bytes: shorten a scene")


def main() -> int:
    if browser() is None:
        print("gen_film: needs Chromium or Chrome", file=sys.stderr)
        return 2
    scenes = sorted(map(scene_of, FILMS.glob("*.toml")), key=lambda scene: scene.order)
    wanted = set(sys.argv[1:]) or {scene.system for scene in scenes}
    pictures = [picture for scene in scenes if scene.system in wanted for picture in filmed(scene)]
    print(f"{FILM}: {write(pictures, FILM)} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
