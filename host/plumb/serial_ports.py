"""Which names of serial ports are opened. pyserial takes URLs that do other things: spy:// empties a file, for one."""

from __future__ import annotations

from plumb.errors import UsageError

URLS = ("socket", "rfc2217")
"""Schemes that reach a port over a network, and nothing else."""


def check_port(port: str) -> None:
    """Raises UsageError for a URL that is neither socket:// nor rfc2217://. Names of devices pass."""
    scheme, mark, _ = port.partition("://")
    if mark and scheme not in URLS:
        raise UsageError(
            f"'{port}' is not opened: a serial port is a device (/dev/ttyUSB0, COM3), socket://HOST:PORT or "
            "rfc2217://HOST:PORT"
        )
