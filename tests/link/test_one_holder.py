"""An arming has one holder: a host that slept through the end of its own, or that receives another's, holds nothing and
steers nothing. Two hosts on one CAN bus, and what each frame of the board says about an arming."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import can
import pytest

from plumb.errors import LinkError
from plumb.link.holding import Holding
from plumb.link.session import Session
from plumb.spec.protocol import Frame, protocol
from support.native_board import UartBoard
from support.sessions import CONTROL, STEER, listen
from support.shared_can import Node, nodes_of

SAFE_US = 50_000
TAG = 5
NUMBER = 700


class Two:
    """Hosts `a` and `b` on the CAN bus of one board, at rest."""

    def __init__(self) -> None:
        self.board = UartBoard()
        self.board.run_us(30_000)
        self.nodes = nodes_of(self.board.mcu, 2)
        self.a, self.b = (Session.over(node) for node in self.nodes)
        self.a.upload(CONTROL, period_us=5000, esc_period_us=2500, arm_hold_ms=0)

    def arm(self, host: Session) -> None:
        host.begin("REALTIME_LIVE")
        host.arm()
        listen(host, 0.1)
        assert self.board.armed and host.armed

    def watched(self, seconds: float) -> None:
        """Host `a` goes on; nobody else does, so the board is safe within 50 ms, and stays so."""
        begin_us = self.board.time_us
        while self.board.time_us < begin_us + seconds * 1e6:
            self.a.receive(0.002)
            assert not self.board.armed or self.board.time_us - begin_us < SAFE_US


@pytest.fixture
def two() -> Iterator[Two]:
    made = Two()
    yield made
    for node in made.nodes:
        can.BusABC.shutdown(node)


def named(node: Node, name: str) -> list[dict[str, int]]:
    message = protocol()[name]
    return [message.decode(data) for identifier, data in node.sent if identifier == message.identifier]


def test_a_host_that_stalled_does_not_hold_what_another_one_armed(two: Two) -> None:
    two.arm(two.a)
    two.a.set_setpoint(STEER)
    two.board.run_us(80_000)  # `a` stalls
    assert not two.board.armed
    two.b.begin("REALTIME_LIVE")
    listen(two.b, 0.7)
    two.b.arm()
    listen(two.b, 0.1)
    assert two.board.armed
    two.nodes[0].sent.clear()  # `b` dies here, and `a` wakes up to all that has come meanwhile
    two.watched(0.5)
    assert not two.a.armed
    assert all(said["value"] == 0 for said in named(two.nodes[0], "KEEPALIVE"))
    assert named(two.nodes[0], "SETPOINT") == []


def test_a_host_learns_that_another_one_has_armed_its_run_anew(two: Two) -> None:
    """On one link every host may arm the run; there is no disarming in between."""
    two.arm(two.a)
    two.b.run_tag = two.a.run_tag
    two.b.arm()
    assert two.b.armed
    two.nodes[0].sent.clear()
    two.watched(0.3)
    assert not two.a.armed
    assert all(said["value"] == 0 for said in named(two.nodes[0], "KEEPALIVE"))
    for setpoint in (STEER, 0):
        with pytest.raises(LinkError, match="another host"):
            two.a.set_setpoint(setpoint)
    assert named(two.nodes[0], "SETPOINT") == []
    two.a.begin("REALTIME_LIVE")  # an order of its own, and it holds the board again
    two.a.arm()
    two.a.set_setpoint(0)
    assert two.a.armed


def test_a_board_that_disarms_itself_takes_no_setpoint_of_its_host(two: Two) -> None:
    two.arm(two.a)
    two.a.set_setpoint(STEER)
    two.board.sensors(faults=1 << 6)
    listen(two.a, 0.2)
    assert not two.board.armed and not two.a.armed
    two.nodes[0].sent.clear()
    with pytest.raises(LinkError, match="not armed any more: arm again"):
        two.a.set_setpoint(STEER)
    listen(two.a, 0.3)
    assert named(two.nodes[0], "SETPOINT") == []
    two.a.set_setpoint(0)  # what arming asks for
    assert [said["setpoint"] for said in named(two.nodes[0], "SETPOINT")] == [0]


def test_the_disarming_of_another_host_is_noticed(two: Two) -> None:
    two.arm(two.a)
    two.b.disarm()
    listen(two.a, 0.05)
    assert not two.board.armed and not two.a.armed


@pytest.mark.parametrize("ends", [Session.disarm, Session.end, Session.close])
def test_an_order_ends_it_at_once(two: Two, ends: Callable[[Session], object]) -> None:
    two.arm(two.a)
    ends(two.a)
    two.board.run_us(2000)
    assert not two.a.armed and not two.board.armed


def test_the_nonce_of_one_host_does_not_arm_for_another(two: Two) -> None:
    """Both ask, both receive both nonces, and the second one takes the board."""
    two.arm(two.a)
    two.a.disarm()
    arm = protocol()["EXECUTE"].value("verb", "ARM")
    two.a.request("CHALLENGE", arm, 0xAAAA0001, answer="NONCE", first=arm)
    nonce = two.b.request("CHALLENGE", arm, 0xBBBB0001, answer="NONCE", first=arm)["nonce"]
    with pytest.raises(LinkError, match="nonce"):
        two.a.request("EXECUTE", arm, nonce ^ 0xAAAA0001)
    assert not two.board.armed


def test_a_host_before_version_3_is_refused_by_name(two: Two) -> None:
    """It says no number of its own, on a bus that another host has greeted."""
    two.arm(two.a)
    two.a.disarm()
    arm = protocol()["EXECUTE"].value("verb", "ARM")
    two.b.receive(0.0)  # the nonces of `a`, which it has received, too
    nonce = two.b.request("CHALLENGE", arm, 0, answer="NONCE", first=arm)["nonce"]
    with pytest.raises(LinkError, match="version") as refused:
        two.b.request("EXECUTE", arm, nonce)
    assert getattr(refused.value, "detail", None) == 1  # for this reason alone
    assert not two.board.armed


# ---- what each frame says ----


def frame(name: str, *words: int, flags: int = 0) -> Frame:
    return protocol()[name].identifier, protocol()[name].pack(0, flags, *words)


def acknowledged(number: int = NUMBER, echo: int = 0x1234) -> Frame:
    return frame("ACK", protocol()["EXECUTE"].identifier, echo << 16 | number)


def held() -> Holding:
    holding = Holding(protocol())
    holding.claim(0x12345678)
    assert holding.follow([acknowledged()], TAG) == [] and holding.number == NUMBER
    return holding


@pytest.mark.parametrize(
    ("said", "another"),
    [
        (frame("STATUS", 2, 0, 0), False),
        (frame("STEP", 1, 2), False),
        (frame("TIME", 1, 2, flags=0), False),
        (frame("TIME", 1, 2, flags=TAG + 1), True),
        (frame("KEEPALIVE_VALUE", NUMBER + 1, 99), True),
    ],
)
def test_each_of_these_frames_alone_ends_it(said: Frame, another: bool) -> None:
    holding = held()
    assert holding.follow([frame("KEEPALIVE_VALUE", NUMBER, 7), said], TAG) == []
    assert (holding.number, holding.another) == (0, another) and holding.over
    assert holding.follow([frame("KEEPALIVE_VALUE", NUMBER, 8)], TAG) == []


@pytest.mark.parametrize(
    "said",
    [
        frame("STATUS", 2, 0, 0, flags=1),
        frame("STEP", 1, 2, flags=1),
        frame("TIME", 1, 2, flags=TAG),
        frame("EVENTS", 0, 0, 0),
        frame("ACK", 8, 0),
    ],
)
def test_these_frames_do_not(said: Frame) -> None:
    holding = held()
    assert holding.follow([frame("KEEPALIVE_VALUE", NUMBER, 7), said], TAG) == [7]
    assert holding.number == NUMBER


def test_the_first_value_may_come_before_the_ack_of_arming() -> None:
    holding = Holding(protocol())
    holding.claim(0x12345678)
    others = [frame("KEEPALIVE_VALUE", NUMBER - 1, 6), frame("STATUS", 2, 0, 0), frame("STEP", 1, 2)]
    assert holding.follow([*others, frame("KEEPALIVE_VALUE", NUMBER, 7)], TAG) == []
    assert holding.follow([acknowledged(), frame("KEEPALIVE_VALUE", NUMBER, 8)], TAG) == [7, 8]


@pytest.mark.parametrize("ack", [acknowledged(echo=0x1235), frame("ACK", 66, 0x12340001)])
def test_the_ack_of_another_host_or_command_begins_nothing(ack: Frame) -> None:
    holding = Holding(protocol())
    holding.claim(0x12345678)
    assert holding.follow([ack, frame("KEEPALIVE_VALUE", 1, 7)], TAG) == []
    assert holding.number == 0
