"""A client of gdb's remote protocol in a few lines: `ask` sends a packet and returns the answer."""

from __future__ import annotations

import socket


class GdbClient:
    """Speaks to a server at a port of this machine; closes the connection at its end."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=60)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # an answer and a packet are two writes

    def __enter__(self) -> GdbClient:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def raw(self, data: bytes) -> None:
        self._socket.sendall(data)

    def send(self, packet: str) -> None:
        data = packet.encode("latin-1")
        self.raw(b"$" + data + f"#{sum(data) & 0xFF:02x}".encode())

    def byte(self) -> bytes:
        """The next byte of the server. Raises ConnectionResetError when it has hung up."""
        data = self._socket.recv(1)
        if not data:
            raise ConnectionResetError("the server hung up")
        return data

    def answer(self) -> str:
        """The next packet of the server; acknowledges it."""
        while self.byte() != b"$":
            pass
        packet = b""
        while (byte := self.byte()) != b"#":
            packet += byte
        assert int(self.byte() + self.byte(), 16) == sum(packet) & 0xFF
        self.raw(b"+")
        return packet.decode("latin-1")

    def ask(self, packet: str) -> str:
        self.send(packet)
        return self.answer()

    def register(self, number: int) -> int:
        return int.from_bytes(bytes.fromhex(self.ask(f"p{number:x}")), "little")

    def word(self, address: int) -> int:
        return int.from_bytes(bytes.fromhex(self.ask(f"m{address:x},4")), "little")

    def monitor(self, command: str) -> str:
        return bytes.fromhex(self.ask("qRcmd," + command.encode().hex())).decode()
