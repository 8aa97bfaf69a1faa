"""How long a host waits for a reply, how often it asks again, and what it counts meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

REPLY_TIMEOUT_S = 0.25
TRIES = 4
IN_FLIGHT = 16
"""Frames that may be on the way to the board without a reply."""


@dataclass
class LinkCounters:
    """Frames that did not make it, seen from here; the board's own counters are in Session.telemetry."""

    lost: int = 0
    repeated_requests: int = 0
