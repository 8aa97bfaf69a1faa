"""How to install plumb's optional dependencies.

The distribution is called plumb-imu: on PyPI, `plumb` is another project. In a checkout an extra is installed from
there; beside an installed wheel pip reads the extra from what is installed.
"""

from __future__ import annotations

from plumb.checkout import IN_CHECKOUT


def install_hint(extra: str) -> str:
    """The command that installs an extra (virtual, bench, flash, monitor, compare, tune, cockpit), as the end of a
    sentence."""
    if IN_CHECKOUT:
        return f"in the checkout of plumb: pip install -e '.[{extra}]'"
    return f"with: pip install 'plumb-imu[{extra}]'"
