"""One end of a bridge: a bus with its own thread, which reads and reopens it; `carry` forwards between two ends."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Container

import can

from plumb.bridge.frame_counts import Flow
from plumb.bridge.latency import LatencyHistogram
from plumb.errors import LinkError, UsageError
from plumb.link.listening import Listening
from plumb.link.transports.open_bus import LogBus, open_bus
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec.protocol import Frame

RECONNECT_INTERVAL_S = 0.5
"""Pause between attempts to open an endpoint."""
PEER_TIMEOUT_S = 1.0
"""A peer that sends no frame for this long counts as lost: the bridge ends the run and asks the peer to restart."""
POLL_INTERVAL_S = 0.1
"""Longest wait for a frame."""
SWAPPED_PORT_HOLDOFF_S = 3 * RECONNECT_INTERVAL_S
"""How long the sensor side leaves a port alone after a board answered on it."""
FIRST_FRAME_HINT_S = 3.0
"""Wait for the first frame of an open bus before the user is asked whether anybody is there."""
LOOP_INTERVAL_S = 0.001
"""Pause between two polls of a quiet bus."""

Open = Callable[[str], can.BusABC]
Say = Callable[[str], None]
Tap = Callable[[list[Frame]], None]
"""Receives all frames that pass."""


class End:
    """One bus, read by its own thread, which reopens it when it fails. Received frames wait in `arrived` with their
    receive time.

    only: identifiers of this end, where both ends share one bus.
    generation: how often the peer (re)appeared. quiet_s: listening time since the last frame. flow.opened counts a UDP
    port when the first frame has come: opening one says nothing about the other side.
    trouble: why the bus is not open, or ''. wrong: the error of a name that can never be opened.
    """

    def __init__(self, spec: str, open_: Open = open_bus, only: Container[int] | None = None) -> None:
        self.spec, self.flow, self._only = spec, Flow(), only
        self.generation = 0
        self._listening, self._closed_s = Listening(time.monotonic), 0.0
        self.trouble = ""
        self.wrong: UsageError | None = None
        self.ended = False
        self.arrived: queue.SimpleQueue[tuple[float, Frame]] = queue.SimpleQueue()
        self._open = open_
        self._bus: can.BusABC | None = None
        self._spoke = False
        self._done = threading.Event()
        self._mistaken = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"bus {spec}", daemon=True)

    @property
    def quiet_s(self) -> float:
        return self._closed_s + self._listening.quiet_s

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._done.set()
        self._thread.join()

    def release(self) -> None:
        """Close the bus and reopen its name after SWAPPED_PORT_HOLDOFF_S."""
        self._mistaken.set()

    def send(self, frames: list[Frame]) -> None:
        """Send frames; they are dropped while the bus is not open."""
        bus = self._bus
        if bus is None:
            return
        try:
            if isinstance(bus, PlumbBus):
                bus.write_frames(frames)
            else:
                for identifier, data in frames:
                    bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False), timeout=0.1)
        except (LinkError, can.CanError, OSError):
            pass  # the reading thread sees the error too, and reopens the bus

    def drain(self) -> list[tuple[float, Frame]]:
        """Frames received since the last call, with their time; raises UsageError for a name that can never be
        opened."""
        if self.wrong is not None:
            raise self.wrong
        return [self.arrived.get() for _ in range(self.arrived.qsize())]

    def _run(self) -> None:
        while not self._done.is_set():
            try:
                with self._open(self.spec) as bus:
                    self._bus, self.trouble = bus, ""
                    self.generation += 1
                    self._spoke = not (isinstance(bus, PlumbBus) and bus.connectionless)
                    self.flow.opened += self._spoke
                    self.flow.forget()
                    self._read(bus)
            except UsageError as error:
                self.wrong = error
                return
            except (LinkError, can.CanError, OSError) as error:
                self.trouble = str(error)
            self._bus = None
            self._closed_s += RECONNECT_INTERVAL_S
            self._done.wait(SWAPPED_PORT_HOLDOFF_S if self._mistaken.is_set() else RECONNECT_INTERVAL_S)
            self._mistaken.clear()

    def _read(self, bus: can.BusABC) -> None:
        self._listening, self._closed_s = Listening(time.monotonic), 0.0
        asked = self._listening.timeout(PEER_TIMEOUT_S)
        while not self._done.is_set() and not self._mistaken.is_set():
            begin_s = time.monotonic()
            message = bus.recv(POLL_INTERVAL_S)
            now_s = time.monotonic()
            own, quiet_s = message is not None and self._is_its_own(message), self.quiet_s
            self._listening.note(POLL_INTERVAL_S, begin_s, own)
            if message is not None and own:
                if quiet_s > PEER_TIMEOUT_S:
                    self.generation += 1
                    self.flow.forget()
                asked.renew()
                if not self._spoke:
                    self._spoke = True
                    self.flow.opened += 1
                frame = message.arbitration_id, bytes(message.data)
                if self.flow.note(*frame):
                    self.arrived.put((now_s, frame))
            elif asked.over and isinstance(bus, PlumbBus):
                bus.write_text(b"O\r")  # a peer that restarted waits for a host to open the link
                asked.renew()
            if isinstance(bus, PlumbBus):
                self.flow.rejected = bus.parser.rejected + bus.parser.bad
            self.ended = isinstance(bus, LogBus) and bus.ended

    def _is_its_own(self, message: can.Message) -> bool:
        data_frame = not message.is_extended_id and not message.is_error_frame
        return data_frame and (self._only is None or message.arbitration_id in self._only)


def carry(
    one: End,
    other: End,
    stopped: Callable[[], bool],
    say: Say = lambda text: None,
    tap: Tap = lambda frames: None,
    latencies: tuple[LatencyHistogram, LatencyHistogram] | None = None,
) -> None:
    """Forward every frame of either side to the other unchanged, until stopped() holds. tap: called with all frames.

    latencies: from one to the other, and back: between the arrival of a frame and the end of its write."""
    said, hinted = {one: "", other: ""}, set[End]()
    down, up = latencies or (LatencyHistogram(), LatencyHistogram())
    while not stopped() and not one.ended and not other.ended:
        moved = False
        for source, target, latency in ((one, other, down), (other, one, up)):
            if source.trouble != said[source]:
                say(f"{source.spec}: {source.trouble or 'open again'}")
                said[source] = source.trouble
            if not source.flow.frames and source.quiet_s > FIRST_FRAME_HINT_S and not source.trouble:
                if source not in hinted:
                    say(f"no frame has come over {source.spec} yet: is anybody there?")
                hinted.add(source)
            arrived = source.drain()
            if arrived:
                frames = [frame for _, frame in arrived]
                target.send(frames)
                sent_s = time.monotonic()
                for arrived_s, _ in arrived:
                    latency.note(sent_s - arrived_s)
                tap(frames)
                moved = True
        if not moved:
            time.sleep(LOOP_INTERVAL_S)
