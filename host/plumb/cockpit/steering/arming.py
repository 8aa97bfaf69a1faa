"""What keeps the board from being armed by the receiver's switch, and why it disarmed, as it says itself.

The board arms by the switch of its receiver; no host asks for it.
"""

from __future__ import annotations

from plumb.link.identity import disarmed_text, plausibility_text
from plumb.link.session import Session


def in_the_way(session: Session) -> str:
    """What the board misses before it may be armed; "" for nothing."""
    return "; ".join(plausibility_text(session.telemetry.get("PLAUSIBILITY", {}), session.parameters.uploaded))


def why_disarmed(session: Session) -> str:
    """What ended the last armed time."""
    said, system = session.telemetry, session.parameters.uploaded
    return disarmed_text(said.get("EVENTS", {}).get("disarm_cause", 0), said.get("PLAUSIBILITY", {}), system)
