"""Write docs/images/report.png: the head of the page that `plumb run` writes, as a browser shows it, 1200 pixels wide.

    .venv/bin/python tools/gen_screenshot.py

Needs Chromium or Chrome. Fonts differ between machines, so no check compares the picture.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from plumb.__main__ import main as plumb

TARGET = Path(__file__).resolve().parent.parent / "docs" / "images" / "report.png"
RUN = ("run", "quad", "--board", "native", "--scenario", "hold", "--out")
WIDTH, HEIGHT = 1200, 1260
"""Pixels: title, verdict, error budget, and the first two plots."""
MOST_BYTES = 200_000
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def main() -> int:
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        print(f"gen_screenshot: none of {', '.join(BROWSERS)} is installed", file=sys.stderr)
        return 2
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        if code := plumb([*RUN, str(folder / "run")]):
            return code
        command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        command += ["--blink-settings=preferredColorScheme=1", f"--user-data-dir={folder / 'profile'}"]
        command += [f"--window-size={WIDTH},{HEIGHT}", f"--screenshot={folder / 'report.png'}"]
        command.append((folder / "run" / "report.html").as_uri())
        subprocess.run(command, check=True, timeout=200, capture_output=True)
        picture = (folder / "report.png").read_bytes()
    if len(picture) > MOST_BYTES:
        print(
            f"gen_screenshot: {len(picture)} bytes are more than {MOST_BYTES}; take less of the page", file=sys.stderr
        )
        return 1
    TARGET.parent.mkdir(parents=True, exist_ok=True)
    TARGET.write_bytes(picture)
    print(f"{TARGET}: {len(picture)} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
