"""Check the name of a serial port before pyserial opens it: some URLs of pyserial do damage (spy:// empties a file)."""

from __future__ import annotations

import stat
from pathlib import Path

from plumb.errors import UsageError
from plumb.link.endpoint_names import quoted

URLS = ("socket", "rfc2217")
"""URL schemes that are accepted: they only open a network connection."""


def check_port(port: str) -> None:
    """Raises UsageError for a URL that is neither socket:// nor rfc2217://, and for a file or a folder.

    The name of a device passes even if the device does not exist.
    """
    scheme, mark, _ = port.partition("://")
    if mark and scheme not in URLS:
        raise UsageError(
            f"{quoted(port)} is not opened: a serial port is a device (/dev/ttyUSB0, COM3), socket://HOST:PORT or "
            "rfc2217://HOST:PORT"
        )
    if mark:
        return
    try:
        mode = Path(port).stat().st_mode
    except (OSError, ValueError):  # not there, or no path: COM3
        return
    if stat.S_ISREG(mode) or stat.S_ISDIR(mode):
        what = "a folder" if stat.S_ISDIR(mode) else "a file"
        raise UsageError(f"{quoted(port)} is {what}, not a serial port: `plumb ports` lists those of this machine")
