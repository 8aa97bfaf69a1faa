"""How to install plumb's optional dependencies.

The distribution is called plumb-imu: on PyPI, `plumb` is another project. In a checkout an extra is installed from
there; where a wheel is installed, pip reads the extra from its metadata.
"""

from __future__ import annotations

from typing import Any

from plumb.checkout import IN_CHECKOUT
from plumb.errors import UsageError


def install_hint(extra: str) -> str:
    """The command that installs an extra (virtual, bench, flash, monitor, compare, tune, cockpit, campaign, mavlink),
    as the end of a sentence."""
    if IN_CHECKOUT:
        return f"in the checkout of plumb: pip install -e '.[{extra}]'"
    return f"with: pip install 'plumb-imu[{extra}]'"


def required(module: str, package: str, purpose: str, extra: str) -> Any:  # Any: a package without types
    """A module of an optional package. Raises UsageError where it is not installed: purpose begins the sentence, the
    command that installs the extra ends it."""
    try:
        return __import__(module, fromlist=["_"])
    except ImportError:
        raise UsageError(f"{purpose} needs the package {package}; install it {install_hint(extra)}") from None
