"""The board's own reports of why the receiver's switch does not arm it, and of why it disarmed.

The board arms by the switch of its receiver; no host asks for it.
"""

from __future__ import annotations

from plumb.link.identity import disarmed_text, plausibility_text
from plumb.link.session import Session


def in_the_way(session: Session) -> str:
    """Conditions for arming that the board misses; "" for none."""
    return "; ".join(plausibility_text(session.telemetry.get("PLAUSIBILITY", {}), session.parameters.uploaded))


def why_disarmed(session: Session) -> str:
    """Reason for the end of the last armed time."""
    said, system = session.telemetry, session.parameters.uploaded
    return disarmed_text(said.get("EVENTS", {}).get("disarm_cause", 0), said.get("PLAUSIBILITY", {}), system)
