"""The limits of the fault table, and the defect that turns each row red, read from limits.toml."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

LIMITS_PATH = Path(__file__).with_name("limits.toml")
SEEN_RED = "seen_red"
"""The table of limits.toml that is no limit."""


@dataclass(frozen=True)
class Limit:
    """safe_ms: longest time until every output is safe. detected_ms: longest time until the board reports. Both in ms
    from the injection. why: where the numbers come from."""

    safe_ms: float
    detected_ms: float
    why: str


@lru_cache(maxsize=1)
def _tables() -> dict[str, dict[str, Any]]:  # Any: TOML
    return tomllib.loads(LIMITS_PATH.read_text("utf-8"))


@lru_cache(maxsize=1)
def limits() -> dict[str, Limit]:
    """By name."""
    return {name: Limit(**row) for name, row in _tables().items() if name != SEEN_RED}


def seen_red() -> dict[str, str]:
    """Row -> the declared defect of the firmware that turns it red. ROW@FEATURE: the row of that name for systems with
    this feature (Scene.features), where another row of the name comes before it."""
    return dict(_tables()[SEEN_RED])
