"""Send UDP datagrams to one address, and listen to none."""

from __future__ import annotations

import contextlib
import errno
import socket

from plumb.errors import LinkError
from plumb.link.endpoint_names import quoted

_NO_LISTENER = (errno.ECONNREFUSED, errno.EAGAIN, errno.ENOBUFS)


class Datagrams:
    """sent: number of datagrams. What arrives at the socket is never read."""

    def __init__(self, host: str, port: int) -> None:
        """Raises LinkError for a host that is not known."""
        self.sent = 0
        try:
            family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind)
        except (OSError, UnicodeError) as error:
            raise LinkError(f"UDP to {quoted(host)} is not possible ({error}): check the address") from None
        self._address = address
        self._socket.setblocking(False)

    def send(self, data: bytes) -> None:
        """A datagram that nobody takes is lost, as UDP is; raises LinkError for a network that is not there."""
        try:
            self._socket.sendto(data, self._address)
            self.sent += 1
        except OSError as error:
            if error.errno not in _NO_LISTENER:
                raise LinkError(f"UDP to {self._address[0]} failed ({error.strerror}): check the network") from None

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._socket.close()
