"""Write the pictures of the pages, as a browser shows them: docs/images/report.png, the head of the page that
`plumb run` writes, and docs/images/cockpit.png, `plumb cockpit` with the armed quad of the virtual board.

    .venv/bin/python tools/gen_screenshot.py [report] [cockpit]

Needs Chromium or Chrome. Fonts differ between machines, so no check compares the picture.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from plumb.__main__ import main as plumb

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from support.chromium import Chromium, browser  # noqa: E402

IMAGES = ROOT / "docs" / "images"
RUN = ("run", "quad", "--board", "native", "--scenario", "hold", "--out")
COCKPIT = ("cockpit", "--board", "virtual", "--system", "quad", "--json")
REPORT_SIZE, COCKPIT_SIZE = (1200, 1260), (1400, 1120)
"""Pixels."""
STEPPED_S, STEPPED_AGAIN_S, SHOWN_S = 16.0, 22.0, 28.0
"""Times of the run on the page: the hand lets go at 10.6 s."""
MOST_BYTES = 200_000


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
    """The quad of the virtual board, armed before it is pulled by hand, after its release and two step tests."""
    with tempfile.TemporaryDirectory() as folder, Chromium() as chromium:
        command = [sys.executable, "-m", "plumb", *COCKPIT, "--out", folder]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            page = chromium.open(json.loads(process.stdout.readline())["control"])
            page.click("[data-do=run]")
            page.until("document.getElementById('health').textContent.includes('blocked bynothing')")
            page.click("[data-do=arm]")
            page.click("[data-do=record]")
            for time_s in (STEPPED_S, STEPPED_AGAIN_S):
                page.until(f"Number(document.getElementById('newest').value) > {time_s}")
                page.click("[data-do=step_test]")
            page.until(f"Number(document.getElementById('newest').value) > {SHOWN_S}")
            return page.picture(*COCKPIT_SIZE)
        finally:
            process.terminate()
            process.wait()


PICTURES = {"report": report, "cockpit": cockpit}

if __name__ == "__main__":
    sys.exit(main())
