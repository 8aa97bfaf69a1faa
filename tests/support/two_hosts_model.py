"""A model of the board that two hosts use, written from docs/reference/protocol.md: links, run, arming, parameters."""

from __future__ import annotations

from dataclasses import dataclass, field

from support.two_hosts import Link

HELLO, IDLE, IN_LOCKSTEP, FAULT, CLOSED, SILENCE, COMMAND, SAMPLES, OWNER = (
    1 << bit for bit in (0, 1, 2, 3, 4, 5, 6, 7, 13)
)
"""Bits of STATUS.blocked."""
SENSORS_SAY = 1 << 11 | 1 << 12
"""The bits of it that the sensors decide, not the hosts: implausible, not ready."""


@dataclass
class LinkModel:
    open: bool = False
    read_only: bool = False
    greeted: bool = False
    received_us: int = field(default=0, repr=False)

    @property
    def lets_in(self) -> bool:
        return self.open and not self.read_only


@dataclass
class BoardModel:
    """What docs/reference/protocol.md says of a board that was just started."""

    in_use: list[int]
    source: int
    link: dict[Link, LinkModel] = field(default_factory=lambda: {link: LinkModel() for link in Link})
    run: str | None = None
    owner: Link | None = None
    tag: int | None = None
    step: int = 0
    armed: bool = False
    at_arming: list[int] = field(default_factory=list)
    cause: int = 0
    staged: list[int] | None = None
    staged_by: Link | None = None

    def disarm(self, cause: int) -> None:
        if self.armed:
            self.armed, self.cause = False, cause

    def lose(self, link: Link, cause: int) -> None:
        """The host of a link is gone."""
        if self.owner is link:
            self.disarm(cause)

    def blocked(self, link: Link, fault: bool) -> int:
        """STATUS.blocked on this link, but for SENSORS_SAY."""
        there = self.link[link]
        return (
            HELLO * (not there.greeted)
            | IDLE * (self.run is None)
            | IN_LOCKSTEP * (self.run == "LOCKSTEP")
            | FAULT * fault
            | CLOSED * (not there.lets_in)
            | OWNER * (self.run is not None and self.owner is not link)
        )
