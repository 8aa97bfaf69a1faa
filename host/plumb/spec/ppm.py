"""The pulse train of a radio receiver, PPM: docs/reference/receiver.md.

A frame has nine pulses; the time from one rising edge to the next is a channel.
"""

from __future__ import annotations

from collections.abc import Sequence

from plumb.spec.crsf import LOW, MIDDLE

CHANNELS = 8
FRAME_US, PULSE_US = 22_500, 300
SHORTEST_US, LONGEST_US = 750, 2250
"""Of a channel; another time ends the frame."""
MIDDLE_US = 1500
LOST_US, FAILSAFE_US = 950, 900
"""A throttle below the first says that the receiver has lost its transmitter; the second is what it then sends."""
THROTTLE = 2


def width_us(channel: int) -> int:
    """The channel of a receiver that has `channel` in CRSF: 988, 1500, 2012 us are 172, 992, 1811 there."""
    return MIDDLE_US + round((channel - MIDDLE) * 5 / 8)


def widths_us(channels: Sequence[int], *, lost: bool = False) -> list[int]:
    """The eight channels of a frame, from those of CRSF. lost: the receiver's failsafe."""
    widths = [width_us(channel) for channel in channels[:CHANNELS]]
    widths += [width_us(LOW)] * (CHANNELS - len(widths))
    if lost:
        widths[THROTTLE] = FAILSAFE_US
    return widths


def edges_us(widths: Sequence[int]) -> list[int]:
    """The rising edges of a frame, from its first one on."""
    edges = [0]
    for width in widths:
        edges.append(edges[-1] + width)
    return edges
