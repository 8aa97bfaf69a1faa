"""A CAN bus on which several hosts receive every frame of a board of this process, each in its own buffer."""

from __future__ import annotations

from collections.abc import Sequence

from plumb.boards.native.mcu import NativeCanBus, NativeMcu
from plumb.spec.protocol import Frame


class Node(NativeCanBus):
    """One host of the bus. sent: the frames that it has sent."""

    def __init__(self, mcu: NativeMcu, nodes: list[Node]) -> None:
        super().__init__(mcu)
        self.sent: list[Frame] = []
        self._nodes = nodes

    def _wait(self, timeout_s: float) -> None:
        end_us = self.mcu.now_us + round(timeout_s * 1e6)
        self._take()
        while not self._frames and self.mcu.now_us < end_us:
            self.mcu.run_us(min(500, end_us - self.mcu.now_us))
            self._take()

    def _take(self) -> None:
        frames = self.mcu.can_receive()
        for node in self._nodes:
            node._frames.extend(frames)

    def write_frames(self, frames: Sequence[Frame]) -> None:
        self.sent += frames
        super().write_frames(frames)


def nodes_of(mcu: NativeMcu, count: int) -> list[Node]:
    nodes: list[Node] = []
    nodes += [Node(mcu, nodes) for _ in range(count)]
    return nodes
