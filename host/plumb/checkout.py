"""The folder of this package, and the checkout around it if there is one."""

from __future__ import annotations

from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
CHECKOUT = PACKAGE.parents[1]
"""Root of the checkout that the package was imported from; of an installed package, a folder without build/ or
tests/."""
IN_CHECKOUT = (CHECKOUT / "host" / "plumb").is_dir()
"""Whether the package was imported from a checkout (or an unpacked sdist)."""
