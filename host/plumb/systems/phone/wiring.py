"""Wiring of the board for `phone`."""

from __future__ import annotations

from plumb.systems.wiring import ADAPTER, CAN, CAN_POWER, COMMON, STRAP_NOTE, Drawing

DRAWINGS = (
    Drawing(
        "phone",
        "phone: samples come over the link, nothing is wired but that",
        "standard",
        left=(ADAPTER, CAN),
        notes=(
            COMMON,
            *CAN_POWER,
            STRAP_NOTE,
            "The phone talks to the host by UDP, the host to the board. This system moves nothing.",
        ),
    ),
)
