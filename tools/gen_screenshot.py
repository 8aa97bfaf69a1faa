"""Write the pictures of the pages, as a browser shows them: docs/images/report.png, the head of the page that
`plumb run` writes, docs/images/cockpit.png, `plumb cockpit` with the armed quad of the virtual board,
docs/images/fly.png, `plumb fly` in a gust, and docs/images/ride.png, `plumb ride` on ice.

    .venv/bin/python tools/gen_screenshot.py [report] [cockpit] [fly] [ride]
    .venv/bin/python tools/gen_screenshot.py --check

Needs Chromium or Chrome. Fonts differ between machines, so --check compares no pixel: each picture has its size, and
names the digest of the files of its page as they are now. It needs no browser.
"""

from __future__ import annotations

import hashlib
import os
import struct
import sys
import tempfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from plumb.__main__ import main as plumb
from plumb.boards import open_link_board
from plumb.boards.plant_on_pins import PlantOfRuns
from plumb.cockpit.board_loop import BoardLoop
from plumb.cockpit.hold import Hold
from plumb.cockpit.steering import transmitter
from plumb.cockpit.steering.trip_loop import TripLoop

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from support.chromium import Chromium, browser  # noqa: E402
from support.cockpit_bench import serving  # noqa: E402
from support.trip_bench import steering  # noqa: E402

HOST = ROOT / "host" / "plumb"
IMAGES = ROOT / "docs" / "images"
RUN = ("run", "quad", "--board", "native", "--scenario", "hold", "--out")
REPORT_SIZE, COCKPIT_SIZE, STEERED_SIZE = (1200, 1260), (1400, 1000), (1120, 640)
"""Pixels."""
STEPPED_S, SHOWN_S = (16.0, 21.0), 27.0
"""Times of the run on the page: the hand lets go at 10.6 s."""
NEWEST = "Number(document.getElementById('newest').value) > {}"
SEED, HOLD_S, BUSY_S = 1000, 30.0, 600.0
MOST_BYTES = 300_000


HEAD_BYTES = 33
"""Signature and IHDR of a PNG."""
KEYWORD = b"Source\0plumb page sha256 "


@dataclass(frozen=True)
class Picture:
    """take: makes it, of this size; page: the files that it shows."""

    take: Callable[[], bytes]
    size: tuple[int, int]
    page: tuple[str, ...]

    @property
    def chunk(self) -> bytes:
        """Names the digest of the page's files, as text of a PNG."""
        digest = hashlib.sha256()
        for path in sorted(path for pattern in self.page for path in HOST.glob(pattern)):
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
        said = KEYWORD + digest.hexdigest().encode()
        return struct.pack(">I", len(said)) + (named := b"tEXt" + said) + struct.pack(">I", zlib.crc32(named))


def main() -> int:
    arguments = sys.argv[1:]
    unknown = set(arguments) - {"--check", *PICTURES}
    if unknown:
        print(f"gen_screenshot: {unknown.pop()}: give {', '.join(PICTURES)} or --check", file=sys.stderr)
        return 2
    wanted = [name for name in PICTURES if name in arguments] or list(PICTURES)
    if "--check" in arguments:
        stale = [f"{name}.png: {why}" for name in wanted if (why := doubt(PICTURES[name], IMAGES / f"{name}.png"))]
        print("\n".join(f"{line}: run tools/gen_screenshot.py" for line in stale) or "pictures are up to date")
        return 1 if stale else 0
    if browser() is None:
        print("gen_screenshot: Chromium is not installed: tools/setup.sh test", file=sys.stderr)
        return 2
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    for name in wanted:
        taken = PICTURES[name].take()
        target = IMAGES / f"{name}.png"
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(taken[:HEAD_BYTES] + PICTURES[name].chunk + taken[HEAD_BYTES:])
        if why := doubt(PICTURES[name], target):
            print(f"gen_screenshot: {name}: {why}", file=sys.stderr)
            return 1
        print(f"{target}: {target.stat().st_size} bytes")
    return 0


def doubt(picture: Picture, path: Path) -> str:
    """Why a picture is not what it should be; "" where it is."""
    if not path.is_file():
        return "is missing"
    data = path.read_bytes()
    size = struct.unpack(">II", data[16:24])
    if size != picture.size:
        return f"is {size[0]}x{size[1]} instead of {picture.size[0]}x{picture.size[1]}"
    if len(data) > MOST_BYTES:
        return f"{len(data)} bytes are more than {MOST_BYTES}"
    return "" if picture.chunk in data else "is older than its page"


def report() -> bytes:
    """Title, verdict, error budget, and the first two plots of a run."""
    with tempfile.TemporaryDirectory() as folder, Chromium() as chromium:
        if code := plumb([*RUN, folder]):
            raise SystemExit(code)
        page = chromium.open((Path(folder) / "report.html").as_uri())
        return page.picture(*REPORT_SIZE)


def cockpit() -> bytes:
    """The quad of the virtual board, as `plumb cockpit --board virtual` has it, armed before a hand pulls it; two step
    tests after it was let go. A busy machine may take longer for a picture than the hold of a user allows."""
    with tempfile.TemporaryDirectory() as folder, Chromium() as chromium:
        plant = PlantOfRuns("quad", None, SEED, open_loop=False)
        hold = Hold(timeout_s=HOLD_S)
        loop = BoardLoop(open_link_board("virtual"), hold, folder=Path(folder), plant=plant, paced=True)
        with serving(loop) as server:
            page = chromium.open(server.control_address)
            page.click("[data-do=record]")
            page.click("[data-do=arm]")
            for time_s in STEPPED_S:
                page.until(NEWEST.format(time_s), patience_s=BUSY_S)
                page.click("[data-do=step_test]")
            page.until(NEWEST.format(SHOWN_S), patience_s=BUSY_S)
            page.value("document.getElementById('slow').hidden = true")  # how fast this machine simulates
            return page.picture(*COCKPIT_SIZE)


def steered(system: str, keys: Sequence[tuple[str, str, bool]], event: str) -> bytes:
    """The page of a vehicle that is on its way, as an event begins. keys: each with the text that is true once it was
    held for long enough, and whether it is let go then. A busy machine may leave the page waiting for longer than a
    receiver does."""
    transmitter.LOST_S = HOLD_S
    with tempfile.TemporaryDirectory() as folder, Chromium() as chromium:
        loop = TripLoop(system, SEED, Hold(HOLD_S), folder=Path(folder))
        with steering(loop) as server:
            page = chromium.open(server.control_address)
            page.call("Emulation.setDeviceMetricsOverride", width=640, height=360, deviceScaleFactor=1, mobile=False)
            page.until("document.getElementById('hint').textContent.includes('Enter')")
            page.click("#motors-on")
            page.until("document.getElementById('armed').textContent === 'ARMED'")
            for code, reached, let_go in keys:
                page.call("Input.dispatchKeyEvent", type="keyDown", code=code, key=code)
                page.until(f"document.getElementById('{reached}", patience_s=BUSY_S)
                if let_go:
                    page.call("Input.dispatchKeyEvent", type="keyUp", code=code, key=code)
            page.click(f"[data-event={event}]")
            page.value("document.getElementById('rate').hidden = document.getElementById('log').hidden = true")
            return page.picture(*STEERED_SIZE)


def fly() -> bytes:
    """The quadrotor a few metres up, on its way, as a gust begins."""
    keys = ("KeyW", "height').textContent > 0.7", True), ("ArrowUp", "speed').textContent > 1.5", False)
    return steered("quadrotor", keys, "gust")


def ride() -> bytes:
    """Two wheels in a turn, as the left one comes to ice."""
    keys = ("KeyW", "speed').textContent > 0.4", False), ("KeyA", "turn').textContent > 35", False)
    return steered("wheels", keys, "ice")


PICTURES = {
    "report": Picture(report, REPORT_SIZE, ("proof/report.css", "proof/report.js")),
    "cockpit": Picture(cockpit, COCKPIT_SIZE, ("cockpit/page/*.*",)),
    "fly": Picture(fly, STEERED_SIZE, ("cockpit/page/steering/*",)),
    "ride": Picture(ride, STEERED_SIZE, ("cockpit/page/steering/*",)),
}

if __name__ == "__main__":
    sys.exit(main())
