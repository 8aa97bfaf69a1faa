"""Time-outs and repetitions of a host's requests, and the counters of what was lost."""

from __future__ import annotations

from dataclasses import dataclass

REPLY_TIMEOUT_S = 0.25
"""Wait for a reply before a request is repeated."""
TRIES = 4
"""Times that a request is sent before the board counts as lost."""
IN_FLIGHT = 16
"""Most frames sent to the board and not answered yet."""


@dataclass
class LinkCounters:
    """Losses seen by the host: frames lost, requests repeated. The board's counters are in Session.telemetry."""

    lost: int = 0
    repeated_requests: int = 0
