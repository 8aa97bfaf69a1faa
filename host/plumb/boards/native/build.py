"""The C core in a checkout: how its libraries are built, and whether one is older than its sources."""

from __future__ import annotations

from pathlib import Path

from plumb.checkout import CHECKOUT, IN_CHECKOUT

BUILD = "cmake --preset native && cmake --build --preset native"
SOURCES = ("core/*.c", "systems/*.c", "ports/batch/*.c")
"""Below firmware/: the sources of the library. Headers are left out: some do not belong to the library, and a change of
such a header does not make the library stale."""


def newer_source(library: Path) -> Path | None:
    """The newest source of the core in this checkout, if it was changed after the library was built; None for a library
    that was not built here."""
    if not IN_CHECKOUT or not library.resolve().is_relative_to(CHECKOUT / "build"):
        return None
    sources = [path for pattern in SOURCES for path in (CHECKOUT / "firmware").glob(pattern)]
    newest = max(sources, key=lambda path: path.stat().st_mtime_ns, default=None)
    if newest is None or newest.stat().st_mtime_ns <= library.stat().st_mtime_ns:
        return None
    return newest.relative_to(CHECKOUT)


def stale_text(library: Path) -> str:
    """One sentence when the library is older than the sources; "" when it is not."""
    source = newer_source(library)
    return f"{library.name} is older than its sources ({source}): run '{BUILD}' in the checkout" if source else ""
