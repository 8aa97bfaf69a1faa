"""Capture of a real-time run: which steps can be verified when frames are lost."""

from __future__ import annotations

import pytest

from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec.protocol import Frame, protocol
from support.native_board import UartBoard

STEPS = 100


def frames_of(step: int) -> list[Frame]:
    """RAW_A, RAW_B and STEP as the board sends them; the number of a RAW frame has six bits."""
    names = protocol()
    counts = [step, 1, 2, 3, 4, 5]
    raw = [
        names[name].pack(step & 15, step >> 4 & 3, *counts[at : at + 3]) for name, at in (("RAW_A", 0), ("RAW_B", 3))
    ]
    sent = [(names[name].identifier, data) for name, data in zip(("RAW_A", "RAW_B"), raw, strict=True)]
    return [*sent, (names["STEP"].identifier, names["STEP"].pack(step & 15, 0, step, 7))]


@pytest.mark.parametrize("lost", ["RAW_A", "RAW_B", "STEP"])
def test_a_step_that_lost_a_frame_is_unverified(lost: str) -> None:
    with Session(PlumbBus(UartBoard())) as session:
        capture = Capture(session)
        for step in range(STEPS):
            dropped = protocol()[lost].identifier if step == 70 else None
            capture.feed([frame for frame in frames_of(step) if frame[0] != dropped])
        assert capture.unverified_from(STEPS) == 70
        assert capture.unverified_from(70) is None
        assert capture.raw[69][:6] == [69, 1, 2, 3, 4, 5]
