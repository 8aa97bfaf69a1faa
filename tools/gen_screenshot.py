"""Write the pictures of the pages, as a browser shows them: docs/images/report.png, the head of the page that
`plumb run` writes, and docs/images/cockpit.png, `plumb cockpit` with the armed quad of the virtual board.

    .venv/bin/python tools/gen_screenshot.py [report] [cockpit]

Needs Chromium or Chrome. Fonts differ between machines, so no check compares the picture.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

from plumb.__main__ import main as plumb
from plumb.boards.link import open_link_board
from plumb.boards.plant_on_pins import PlantOfRuns
from plumb.cockpit.board_loop import BoardLoop
from plumb.cockpit.hold import Hold

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from support.chromium import Chromium, browser  # noqa: E402
from support.cockpit_bench import serving  # noqa: E402

IMAGES = ROOT / "docs" / "images"
RUN = ("run", "quad", "--board", "native", "--scenario", "hold", "--out")
REPORT_SIZE, COCKPIT_SIZE = (1200, 1260), (1400, 1000)
"""Pixels."""
STEPPED_S, SHOWN_S = (16.0, 21.0), 27.0
"""Times of the run on the page: the hand lets go at 10.6 s."""
NEWEST = "Number(document.getElementById('newest').value) > {}"
SEED, HOLD_S, BUSY_S = 1000, 30.0, 600.0
MOST_BYTES = 300_000


def main() -> int:
    if browser() is None:
        print("gen_screenshot: Chromium is not installed: tools/setup.sh test", file=sys.stderr)
        return 2
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    wanted = sys.argv[1:] or list(PICTURES)
    for name in wanted:
        picture = PICTURES[name]()
        if len(picture) > MOST_BYTES:
            print(f"gen_screenshot: {name}: {len(picture)} bytes are more than {MOST_BYTES}", file=sys.stderr)
            return 1
        target = IMAGES / f"{name}.png"
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(picture)
        print(f"{target}: {len(picture)} bytes")
    return 0


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
            return page.picture(*COCKPIT_SIZE)


PICTURES = {"report": report, "cockpit": cockpit}

if __name__ == "__main__":
    sys.exit(main())
