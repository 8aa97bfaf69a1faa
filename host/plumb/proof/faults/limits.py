"""The limits of the fault table, read from limits.toml."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

LIMITS_PATH = Path(__file__).with_name("limits.toml")


@dataclass(frozen=True)
class Limit:
    """safe_ms: longest time until every output is safe. detected_ms: longest time until the board reports. Both in ms
    from the injection. why: where the numbers come from."""

    safe_ms: float
    detected_ms: float
    why: str


@lru_cache(maxsize=1)
def limits() -> dict[str, Limit]:
    """By name."""
    return {name: Limit(**row) for name, row in tomllib.loads(LIMITS_PATH.read_text("utf-8")).items()}
