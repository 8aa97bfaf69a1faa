"""Names of boards, buses and served ports: each form parses into one typed value, other text is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from plumb.errors import UsageError
from plumb.link.endpoint_names import (
    AdapterName,
    CanName,
    FileName,
    LocalBoard,
    PtyName,
    SerialName,
    SocketcandName,
    SocketcandServerName,
    TcpName,
    UdpName,
    parse_board,
    parse_bus,
    parse_can_end,
    parse_endpoint,
)

PORT = "serial:/dev/ttyUSB0"
URLS = ("rfc2217://pi:4000", "rfc2217://[::1]:4000", "rfc2217://pi:4000?poll_modem&timeout=5")
NO_URLS = (
    "socket://host:99999", "socket://host", "socket://", "rfc2217://host:99999", "rfc2217://host", "rfc2217://",
    "rfc2217://host:4000?speed=1",
)  # fmt: skip
KVASER = CanName("can:kvaser:0@250", "kvaser", "0", 250)
SOCKETCAND = SocketcandName("can:socketcand:pi:29536:can0", "socketcand", "can0", 500, "pi", 29536)


@pytest.mark.parametrize(
    ("parse", "text", "name"),
    [
        *((parse_board, kind, LocalBoard(kind)) for kind in ("fixed", "native", "qemu", "virtual")),
        *((parse_board, f"qemu:{core}", LocalBoard("qemu", core)) for core in ("m0", "m3", "m4", "m7")),
        *((parse, PORT, SerialName("/dev/ttyUSB0", 921600)) for parse in (parse_board, parse_bus)),
        *((parse, f"{PORT}@115200", SerialName("/dev/ttyUSB0", 115200)) for parse in (parse_board, parse_bus)),
        (parse_board, "serial:socket://pi:4000", SerialName("socket://pi:4000")),
        *((parse_board, f"serial:{url}", SerialName(url)) for url in URLS),
        *((parse, KVASER.text, KVASER) for parse in (parse_board, parse_bus)),
        (parse_bus, "can:pcan:PCAN_USBBUS1", CanName("can:pcan:PCAN_USBBUS1", "pcan", "PCAN_USBBUS1", 500)),
        (parse_bus, SOCKETCAND.text, SOCKETCAND),
        (parse_bus, "tcp:127.0.0.1:4000", TcpName("127.0.0.1", 4000)),
        (parse_bus, "tcp:::1:4000", TcpName("::1", 4000)),
        (parse_bus, "udp:4000", UdpName(4000)),
        (parse_bus, "file:a:b.asc", FileName("a:b.asc")),
        (parse_endpoint, "pty", PtyName()),
        (parse_endpoint, "tcp:0", TcpName("127.0.0.1", 0)),
        (parse_can_end, "slcan:pty", AdapterName(PtyName())),
        (parse_can_end, "slcan:tcp:4001", AdapterName(TcpName("127.0.0.1", 4001))),
        (parse_can_end, "socketcand:4002", SocketcandServerName(4002)),
        (parse_can_end, "socketcan:vcan0@125", CanName("can:socketcan:vcan0@125", "socketcan", "vcan0", 125)),
    ],
)  # fmt: skip
def test_every_form_of_a_name_has_one_meaning(parse: Callable[[str], Any], text: str, name: object) -> None:
    assert parse(text) == name


def test_the_rate_behind_an_slcan_channel_is_that_of_the_adapters_port() -> None:
    name = parse_can_end("slcan:/dev/ttyACM0@115200")
    assert isinstance(name, CanName) and (name.channel, name.kbit) == ("/dev/ttyACM0@115200", 500)


@pytest.mark.parametrize(
    ("parse", "text", "sentence"),
    [
        (parse_board, "", "is not a board"),
        (parse_board, "virtual:", "is not a board"),
        (parse_board, "tcp:127.0.0.1:4000", "is not a board"),
        (parse_board, "serial:", "is not a board"),
        (parse_bus, "native", "is not a bus"),
        (parse_bus, "file:", "is not a bus"),
        (parse_bus, "can:kvaser", "is not a bus"),
        (parse_bus, "can::0", "is not a bus"),
        *((parse_board, f"{PORT}@{rate}", "baud rate") for rate in ("fast", "", "²", "9" * 5000)),
        *((parse, f"{PORT}@0", "a rate is a number above 0") for parse in (parse_board, parse_bus)),
        (parse_board, "can:kvaser:0@0", "a rate is a number above 0"),
        (parse_bus, "can:slcan:/dev/ttyACM0@00", "a rate is a number above 0"),
        *((parse_board, f"serial:{url}", "HOST:PORT") for url in NO_URLS),
        (parse_bus, f"{PORT}@fast", "baud rate"),
        (parse_bus, "tcp:127.0.0.1:65536", "is not an address"),
        (parse_bus, "tcp::4000", "is not an address"),
        (parse_bus, "udp:٣", "a port is a number"),
        (parse_bus, "can:socketcand:pi:29536", "HOST:PORT:CHANNEL"),
        (parse_endpoint, "tcp:", "pty or tcp:PORT"),
        (parse_endpoint, "pty:1", "pty or tcp:PORT"),
        (parse_can_end, "slcan:tcp:99999", "pty or tcp:PORT"),
        (parse_can_end, "can:socketcan:can0", "is not a CAN bus; write slcan:pty"),
        (parse_can_end, "socketcand:99999", "HOST:PORT:CHANNEL"),
        (parse_can_end, "vcan0", "is not a CAN bus"),
    ],
)  # fmt: skip
def test_other_text_is_refused_with_the_grammar(parse: Callable[[str], Any], text: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence) as caught:
        parse(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("parse", "kind"),
    [
        *((parse_board, kind) for kind in ("", "serial:rfc2217://", "serial:socket://", "serial:COM1@", "can:")),
        *((parse_bus, kind) for kind in ("tcp:", "udp:", "can:socketcand:")),
        *((parse, "") for parse in (parse_can_end, parse_endpoint)),
    ],
)
def test_a_long_name_is_cut_in_the_error(parse: Callable[[str], Any], kind: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse(kind + 100_000 * "x")
    assert "xxx..." in str(caught.value) and len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("/dev/ttyACM0@115200", "serial:/dev/ttyACM0@115200"),
        ("ttyUSB0", "serial:/dev/ttyUSB0"),
        ("cu.usbserial-110", "serial:/dev/cu.usbserial-110"),
        ("COM3", "serial:COM3"),
        ("socket://127.0.0.1:4000", "serial:socket://127.0.0.1:4000"),
        ("tcp:127.0.0.1:4000", "serial:socket://127.0.0.1:4000"),
        ("can0", "can:socketcan:can0"),
        ("vcan1@250", "can:socketcan:vcan1@250"),
        ("slcan:/dev/ttyACM0", "can:slcan:/dev/ttyACM0"),
        ("Virtual", "virtual"),
        ("nativ", "native"),
        ("aut", "auto"),
        ("toaster", None),
        ("x" * 10_000, None),
    ],
)
def test_a_board_without_its_kind_or_mistyped_is_guessed(text: str, meant: str | None) -> None:
    with pytest.raises(UsageError, match="is not a board") as caught:
        parse_board(text)
    found = str(caught.value).partition(" (did you mean ")[2].partition("?)")[0]
    assert found == (meant or "")
    if meant and meant != "auto":
        parse_board(meant)
