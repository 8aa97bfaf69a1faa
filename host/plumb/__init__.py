"""plumb: attitude estimation and control in integers, the same answer bit for bit from Python to silicon."""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    __version__: str
    """Version of the package, from git's tags: `plumb.version`."""


def __getattr__(name: str) -> object:
    if name == "__version__":
        from plumb.version import installed

        return installed().version
    raise AttributeError(f"module 'plumb' has no attribute '{name}'")
