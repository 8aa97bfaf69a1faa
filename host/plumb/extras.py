"""How to install plumb's optional dependencies.

The distribution is called plumb-imu and lives in a checkout: an extra is installed from there, never by name from an
index, where `plumb` belongs to another project.
"""

from __future__ import annotations


def install_hint(extra: str) -> str:
    """The command that installs an extra (virtual, bench, report, flash) of a checkout, as the end of a sentence."""
    return f"in the checkout of plumb: pip install -e '.[{extra}]'"
