"""Commands with a nonce, for the host that asked for it alone.

On a bus two hosts may ask at once, and each receives the other's NONCE and ACK. So a command by which a host gets hold
of the board carries the nonce XORed with a random number of that host, and its ACK repeats bits of what the command
carried.
"""

from __future__ import annotations

import random
from typing import Protocol

from plumb.errors import LinkError
from plumb.link.holding import Holding
from plumb.link.identity import NackError
from plumb.link.retries import TRIES
from plumb.spec import protocol

ECHO_MASK = {"RUN_BEGIN": 0xFFF00000, "EXECUTE": 0xFFFF0000}
"""Bits of the nonce, as it was sent, in the detail of the ACK of RUN_BEGIN and of EXECUTE ARM."""


class Commanding(Protocol):
    """The part of a session that it needs."""

    protocol: protocol.Protocol
    holding: Holding
    askers: random.Random

    def request(
        self, name: str, *words: int, answer: str = "ACK", first: int | None = None, flags: int = 0, echo: int = 0
    ) -> dict[str, int]: ...


def execute_with_nonce(session: Commanding, request: str, verb: int, flags: int = 0) -> int:
    """Request a nonce and send the command with it; returns the detail of its ACK. Tries again with a new nonce if a
    reply was lost."""
    arms = request == "EXECUTE" and verb == session.protocol["EXECUTE"].value("verb", "ARM")
    holds = arms or request == "RUN_BEGIN"
    for attempt in range(TRIES):
        asker = session.askers.randint(1, 0xFFFFFFFF) if holds else 0
        nonce = asker ^ session.request("CHALLENGE", verb, asker, answer="NONCE", first=verb)["nonce"]
        if arms:
            session.holding.claim(nonce)
        try:
            return session.request(request, verb, nonce, flags=flags, echo=ECHO_MASK[request] if holds else 0)["detail"]
        except NackError as error:
            if error.reason != "NONCE" or attempt == TRIES - 1:
                raise
        finally:
            session.holding.unclaim()
    raise LinkError("the board accepts no nonce")
