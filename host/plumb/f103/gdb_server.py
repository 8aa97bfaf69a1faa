"""Serves machines to gdb: its remote serial protocol, on a port of the loopback address.

    server = machine.debug(3333)        # target extended-remote :3333

A machine stands while gdb looks, and its time with it. There are no threads. One debugger is served at a time; when it
leaves, hangs up or sends nonsense, its breakpoints are dropped and the machine runs on. The packets: "Remote Serial
Protocol" in the manual of gdb.
"""

from __future__ import annotations

import os
import re
import select
import socket
import time
from collections.abc import Callable

from plumb.errors import LinkError, UsageError
from plumb.f103.debug_hold import ACCESS, REGISTERS, WATCHED, Chip, DebugHold, Point, Stop
from plumb.f103.gdb_description import PACKET_BYTES, SIMPLE, memory_map_xml, target_xml, unescaped
from plumb.f103.gdb_monitor import answer

LOOK_S = 0.005
"""A machine that runs looks at its debugger this often."""
STAND_LOOK_S = 0.1
PATIENCE_S = 5.0
"""A debugger that reads nothing for this long is given up."""
SIGNALS = {"asked": 2, "fault": 11}
"""SIGINT and SIGSEGV; all others are SIGTRAP."""
INTERRUPT = b"\x03"
_PACKET = re.compile(rb"\$([^#]*)#([0-9a-fA-F]{2})", re.DOTALL)
_GOES = re.compile(r"(?:vCont;)?([cCsS])(?:[0-9a-f]{2}(?=$|[;:]))?;?([0-9a-f]*)")


class _Gone(Exception):
    """The debugger is not served any more; the message says why, "" when it asked to leave."""


class _Line:
    """The connection to one debugger: packets both ways. Raises _Gone."""

    def __init__(self, client: socket.socket) -> None:
        client.settimeout(PATIENCE_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client, self._received, self._sent = client, b"", b""
        self.acknowledges = True

    def send(self, text: str) -> None:
        data = text.encode("latin-1")
        self._sent = b"$" + data + f"#{sum(data) & 0xFF:02x}".encode()
        self._write(self._sent)

    def _write(self, data: bytes) -> None:
        try:
            self._client.sendall(data)
        except OSError as error:
            raise _Gone(f"does not read ({error})") from None

    def receive(self, timeout_s: float) -> bytes | None:
        """The next packet, or INTERRUPT; None where none came in this time."""
        packet = self._next()
        if packet is not None or not select.select([self._client], [], [], timeout_s)[0]:
            return packet
        try:
            data = self._client.recv(PACKET_BYTES)
        except OSError as error:
            raise _Gone(f"has gone ({error})") from None
        if not data:
            raise _Gone("has hung up")
        self._received += data
        return self._next()

    def _next(self) -> bytes | None:
        """The first whole packet of what was received."""
        while self._received:
            head = self._received[:1]
            if head in b"+-" + INTERRUPT:
                self._received = self._received[1:]
                if head == b"-":
                    self._write(self._sent)
                if head == INTERRUPT:
                    return INTERRUPT
                continue
            found = _PACKET.match(self._received)
            if found is not None:
                self._received = self._received[found.end() :]
                good = sum(found[1]) & 0xFF == int(found[2], 16)
                if self.acknowledges:
                    self._write(b"+" if good else b"-")
                if good:
                    return found[1]
            elif head != b"$" or len(self._received) > 2 * PACKET_BYTES or re.match(rb"[^#]*#..", self._received):
                raise _Gone("does not speak the protocol of gdb")
            else:
                return None
        return None

    def close(self) -> None:
        self._client.close()


class GdbServer:
    """Listens on a port; 0 takes a free one. Raises LinkError for a port that is taken, UsageError for a number that is
    no port.

    waits: machines stand until a debugger has come. say: gets a sentence when a debugger goes without leaving. ends:
    looked at while a machine stands; True lets it run on. tell: called several times a second meanwhile. stood_s: how
    long machines have stood so far.
    """

    def __init__(
        self,
        port: int = 0,
        *,
        waits: bool = False,
        say: Callable[[str], object] = print,
    ) -> None:
        try:
            self._listening = socket.create_server(("127.0.0.1", port), backlog=4)
        except OverflowError:
            raise UsageError(f"gdb cannot be served at port {port}: give a number up to 65535, or 0") from None
        except OSError as error:
            why = os.strerror(error.errno) if error.errno else str(error)
            raise LinkError(f"gdb cannot be served at port {port} of 127.0.0.1: {why}; choose another port") from None
        self._listening.setblocking(False)
        self.port = int(self._listening.getsockname()[1])
        self.points: frozenset[Point] = frozenset()
        self.stood_s = 0.0
        self.ends: Callable[[], bool] = lambda: False
        self.tell: Callable[[], object] = lambda: None
        self._waits, self._say, self._announced = waits, say, ""
        self._line: _Line | None = None
        self._early: bytes | None = None
        """A packet that came while the machine ran."""
        self._running = False
        self._look_s = 0.0
        self._stop = Stop("step")

    def hold(self, machine: Chip, advance: Callable[[int], None]) -> DebugHold:
        """The hold on a machine, of which `advance` makes a step."""
        return DebugHold(machine, advance, self)

    def announce(self, command: str) -> None:
        """Say once how gdb comes here."""
        if command != self._announced:
            self._announced = command
            self._say(("waits for gdb: " if self._waits else "gdb may come: ") + command)

    def close(self) -> None:
        """Serve nobody any more: machines run on."""
        self._leave("")
        self._listening.close()

    def _accept(self) -> None:
        """Serve the debugger that knocks; a second one is sent away."""
        try:
            client, _address = self._listening.accept()
        except OSError:  # nobody, or it has gone already, or this server is closed
            return
        if self._line is not None:
            client.close()
            return
        self._line, self._running, self._early, self._stop = _Line(client), False, None, Stop("step")

    def _leave(self, why: str) -> None:
        if self._line is None:
            return
        self._line.close()
        self._line, self.points = None, frozenset()
        if why:
            self._say(f"the debugger at port {self.port} {why}: its breakpoints are dropped, and the board runs on")

    # What a hold asks

    @property
    def attached(self) -> bool:
        return self._line is not None

    def wants_stop(self) -> bool:
        now_s = time.monotonic()
        if now_s < self._look_s:
            return False
        self._look_s = now_s + LOOK_S
        was_attached = self.attached
        self._accept()
        while self._waits and not self.attached and not self.ends():
            select.select([self._listening], [], [], STAND_LOOK_S)
            self._accept()
        self._waits = False
        if self._line is None or not was_attached:
            return self.attached
        try:
            self._early = self._line.receive(0)
        except _Gone as gone:
            self._leave(str(gone))
        return self._early is not None

    def stand(self, hold: DebugHold, stop: Stop) -> bool:
        begin_s, goes = time.monotonic(), None
        try:
            if self._running and self._line is not None:
                self._stop, self._running = stop, False
                self._line.send(self._stop_reply())
            while goes is None and self._line is not None and not self.ends():
                self.tell()
                packet, self._early = self._early or self._line.receive(STAND_LOOK_S), None
                self._accept()
                if packet is not None and packet != INTERRUPT:
                    goes = self._obey(hold, packet.decode("latin-1"))
        except _Gone as gone:
            self._leave(str(gone))
        if goes is None:
            self._leave("")
        self._running = goes is not None
        self.stood_s += time.monotonic() - begin_s
        return bool(goes)

    # Packets

    def _obey(self, hold: DebugHold, packet: str) -> bool | None:
        """Carry the packet out. Returns None, or when the machine is to go on, whether for one instruction."""
        assert self._line is not None
        goes = _GOES.match(packet)
        if goes is not None and packet != "vCont?":
            if goes[2] and not packet.startswith("v"):
                hold.set_register("pc", int(goes[2], 16))
            return goes[1] in "sS"
        if packet[:1] in ("D", "k") or packet.startswith("vKill"):
            if packet[0] != "k":
                self._line.send("OK")
            raise _Gone
        try:
            reply = self._reply(hold, packet)
        except (ValueError, KeyError, IndexError, OverflowError):
            reply = "E01"
        self._line.send(reply)
        if packet == "QStartNoAckMode":
            self._line.acknowledges = False
        return None

    def _reply(self, hold: DebugHold, packet: str) -> str:
        for begin, reply in SIMPLE.items():
            if packet.startswith(begin):
                return reply
        kind, rest = packet[:1], packet[1:]
        if packet == "QStartNoAckMode":
            return "OK"
        if kind == "?":
            return self._stop_reply()
        if kind in ("g", "p"):
            names = list(REGISTERS) if kind == "g" else [list(REGISTERS)[int(rest, 16)]]
            return "".join(hold.register(name).to_bytes(4, "little").hex() for name in names)
        if kind in ("G", "P"):
            return self._write_registers(hold, rest, int(rest.split("=")[0], 16) if kind == "P" else None)
        if kind == "m":
            address, size = (int(number, 16) for number in rest.split(","))
            return hold.read(address, min(size, PACKET_BYTES // 2)).hex() or "E01"
        if kind in ("M", "X"):
            place, data = rest.split(":", 1)
            return self._write_memory(hold, place, bytes.fromhex(data) if kind == "M" else unescaped(data))
        if kind in ("Z", "z"):
            return self._set_point(kind, *(int(number, 16) for number in rest.split(";")[0].split(",")))
        if kind == "R":
            hold.machine.reset()
        return self._query(hold, packet)

    def _stop_reply(self) -> str:
        why, address = self._stop
        watched = f"{why}:{address:x};" if why in WATCHED.values() else ""
        return f"T{SIGNALS.get(why, 5):02x}{watched}"

    def _write_registers(self, hold: DebugHold, text: str, first: int | None) -> str:
        data = bytes.fromhex(text if first is None else text.split("=")[1])
        names = list(REGISTERS)[first or 0 :]
        if len(data) % 4 or not 0 < len(data) <= 4 * len(names):
            return "E01"
        for place, name in zip(range(0, len(data), 4), names, strict=False):
            hold.set_register(name, int.from_bytes(data[place : place + 4], "little"))
        return "OK"

    def _write_memory(self, hold: DebugHold, place: str, data: bytes) -> str:
        address, size = (int(number, 16) for number in place.split(","))
        return "OK" if size == len(data) and (not data or hold.write(address, data)) else "E01"

    def _set_point(self, kind: str, what: int, address: int, size: int) -> str:
        if what > ACCESS:
            return ""
        if address + size > 1 << 32 or size > PACKET_BYTES:
            return "E01"
        point = Point(what, address & ~1 if what not in WATCHED else address, size)
        self.points = self.points | {point} if kind == "Z" else self.points - {point}
        return "OK"

    def _query(self, hold: DebugHold, packet: str) -> str:
        if packet.startswith("qRcmd,"):
            return (answer(hold.machine, bytes.fromhex(packet[6:]).decode("latin-1")) + "\n").encode().hex()
        for name, document in (("features:read:target.xml", target_xml), ("memory-map:read:", memory_map_xml)):
            if packet.startswith(f"qXfer:{name}:"):
                first, size = (int(number, 16) for number in packet.rsplit(":", 1)[1].split(","))
                text = document(hold.machine)
                part = text[first : first + min(size, PACKET_BYTES - 8)]
                return ("m" if first + len(part) < len(text) else "l") + part
        return ""
