"""Inputs that every scenario refuses: an unknown name, and a length, a period or a seed beyond its limits."""

from __future__ import annotations

from collections.abc import Mapping

from plumb.errors import UsageError

LENGTH_S = 1.0, 3600.0


def length_s(
    system: str,
    name: str,
    own_s: Mapping[str, float],
    asked_s: float | None,
    period_us: int,
    range_us: tuple[int, int],
    seed: int,
) -> float:
    """Length of a run in s: asked_s, or the scenario's own. own_s: scenario -> its length. Raises UsageError."""
    if name not in own_s:
        raise UsageError(f"{system} has no scenario '{name}'; it has {', '.join(own_s)}")
    seconds = own_s[name] if asked_s is None else asked_s
    if not LENGTH_S[0] <= seconds <= LENGTH_S[1] or not range_us[0] <= period_us <= range_us[1]:
        raise UsageError(
            f"a run takes {LENGTH_S[0]:g} to {LENGTH_S[1]:g} s at a period of {range_us[0]} to {range_us[1]} us"
        )
    if seed < 0:
        raise UsageError(f"a seed is 0 or more, not {seed}")
    return seconds
