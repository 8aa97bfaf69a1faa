"""No damage passes: CRC-8 over identifier, length and payload, the same in C and Python."""

from __future__ import annotations

import ctypes
import random

import pytest

from link_board import library, parse
from plumb.protocol import check, crc8, protocol
from plumb.slcan import SlcanParser, text_of_frames


def frames(count: int, seed: int) -> list[tuple[int, bytes]]:
    rng = random.Random(seed)
    result = []
    for _ in range(count):
        identifier, body = rng.randrange(0x800), rng.randbytes(7)
        result.append((identifier, bytes([crc8(identifier, b"\0" + body)]) + body))
    return result


def test_published_check_value() -> None:
    # CRC-8/AUTOSAR (0x2F): "123456789" gives 0xDF. Fed here as identifier 0x3132, which is wider than a real one,
    # length 0x33 and the other digits.
    data = (ctypes.c_uint8 * 8)(0, *b"456789", 0)
    state = library().link_board_crc8(0x3132, 0x33, data) ^ 0xFF
    # One byte too many went in, a zero: take it back by searching the state before.
    before = [s for s in range(256) if _step(s, 0) == state]
    assert [s ^ 0xFF for s in before] == [0xDF]


def _step(crc: int, byte: int) -> int:
    crc ^= byte
    for _ in range(8):
        crc = ((crc << 1) ^ 0x2F) & 0xFF if crc & 0x80 else crc << 1
    return crc


def test_c_and_python_agree() -> None:
    for identifier, data in frames(500, 1):
        assert library().link_board_crc8(identifier, 8, (ctypes.c_uint8 * 8)(*data)) == data[0]


@pytest.mark.parametrize("length", range(8))
def test_a_shorter_frame_is_none_even_with_its_crc(length: int) -> None:
    body = bytes(range(1, 8))[: max(length - 1, 0)]
    data = (b"\0" + body).ljust(8, b"\0")
    crc = library().link_board_crc8(0x123, length, (ctypes.c_uint8 * 8)(*data))
    text = text_of_frames([(0x123, (bytes([crc]) + body)[:length])])
    assert parse(text) == ([], 0)
    assert SlcanParser().feed(text) == []


def survivors(text: bytes, frame: tuple[int, bytes]) -> list[tuple[int, bytes]]:
    """Frames that come out of damaged text, in C and in Python, other than the one that went in."""
    ours = SlcanParser().feed(b"\r" + text + b"\r")
    theirs, _ = parse(b"\r" + text + b"\r")
    assert ours == theirs
    return [f for f in ours if f != frame]


@pytest.mark.parametrize("seed", range(4))
def test_every_one_bit_error_is_rejected(seed: int) -> None:
    for frame in frames(12, 10 + seed):
        text = text_of_frames([frame])
        for bit in range(8 * len(text)):
            damaged = bytearray(text)
            damaged[bit // 8] ^= 1 << bit % 8
            assert survivors(bytes(damaged), frame) == []


def test_every_one_byte_error_is_rejected() -> None:
    rng = random.Random(3)
    for frame in frames(10, 4):
        text = text_of_frames([frame])
        for at in range(len(text)):
            for value in rng.sample(range(256), 40):
                damaged = text[:at] + bytes([value]) + text[at + 1 :]
                assert survivors(damaged, frame) == []


def test_every_dropped_and_doubled_byte_is_rejected() -> None:
    for frame in frames(60, 5):
        text = text_of_frames([frame])
        for at in range(len(text)):
            assert survivors(text[:at] + text[at + 1 :], frame) == []
            assert survivors(text[: at + 1] + text[at:], frame) == []


def test_every_three_bit_error_of_a_frame_is_rejected() -> None:
    # 64 bits of payload taken three at a time: linear, so one frame stands for all.
    identifier, data = frames(1, 6)[0]
    value = int.from_bytes(data, "little")
    for a in range(64):
        for b in range(a):
            for c in range(b):
                assert not check(identifier, (value ^ 1 << a ^ 1 << b ^ 1 << c).to_bytes(8, "little"))


def test_another_identifier_or_length_is_rejected() -> None:
    identifier, data = frames(1, 7)[0]
    assert sum(check(other, data) for other in range(0x800)) <= 0x800 // 256 + 2
    assert not any(check(identifier ^ 1 << bit, data) for bit in range(11))
    assert not check(identifier, data[:7])


def test_messages_carry_counter_and_flags() -> None:
    message = protocol()["STEP"]
    data = message.pack(13, 0b1001, 65535, 0xDEADBEEF)
    assert check(message.identifier, data)
    assert data[1] == 0x9D
    assert data[2:] == bytes.fromhex("ffffefbeadde")
    assert message.decode(data) == {
        "armed": 1, "live": 0, "saturated": 0, "dropped": 1, "step": 65535, "digest": 0xDEADBEEF,
    }  # fmt: skip
