"""The CRC-8 of a frame: its definition, the errors it finds on CAN bits and on UART text, the same in C and Python."""

from __future__ import annotations

import ctypes
import random
from itertools import combinations

import pytest

from plumb.link.transports.slcan import SlcanParser, text_of_frames
from plumb.spec.protocol import check, crc8, protocol
from support.link_functions import library, parse


def frames(count: int, seed: int) -> list[tuple[int, bytes]]:
    rng = random.Random(seed)
    result = []
    for _ in range(count):
        identifier, body = rng.randrange(0x800), rng.randbytes(7)
        result.append((identifier, bytes([crc8(identifier, b"\0" + body)]) + body))
    return result


def _crc_by_bits(covered: bytes) -> int:
    """The definition, bit by bit: polynomial x^8 + x^5 + x^3 + x^2 + x + 1 (0x2F), least significant bits first."""
    crc = 0xFF
    for byte in covered:
        for place in range(8):
            feedback = crc & 1 ^ byte >> place & 1
            crc = crc >> 1 ^ (0b11110100 if feedback else 0)  # 0x2F mirrored
    return crc ^ 0xFF


def _mirrored(byte: int) -> int:
    return int(f"{byte:08b}"[::-1], 2)


def test_crc_matches_its_definition() -> None:
    # CRC-8/AUTOSAR (0x2F) of "123456789" is 0xDF; ours is the same with the bits of every byte in reverse order.
    assert _mirrored(_crc_by_bits(bytes(map(_mirrored, b"123456789")))) == 0xDF
    bytes_8 = (ctypes.c_uint8 * 8)(0, *b"9876543")
    assert library().frames_crc8(0x3132, 0x33, bytes_8) == _crc_by_bits(b"1233456789")
    for identifier, data in frames(50, 8):
        covered = identifier.to_bytes(2, "big") + b"\x08" + data[:0:-1]
        assert crc8(identifier, data) == _crc_by_bits(covered)


def test_c_and_python_agree() -> None:
    for identifier, data in frames(500, 1):
        assert library().frames_crc8(identifier, 8, (ctypes.c_uint8 * 8)(*data)) == data[0]


@pytest.mark.parametrize("length", range(8))
def test_a_shorter_frame_is_none_even_with_its_crc(length: int) -> None:
    body = bytes(range(1, 8))[: max(length - 1, 0)]
    data = (b"\0" + body).ljust(8, b"\0")
    crc = library().frames_crc8(0x123, length, (ctypes.c_uint8 * 8)(*data))
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


def wire_position(bit: int) -> int:
    """Mask, in the payload read as one little-endian integer, of the bit that CAN sends as number 0..63.

    CAN sends byte 0 first and the most significant bit of each byte first.
    """
    return 1 << 8 * (bit // 8) + 7 - bit % 8


def bursts(longest: int) -> list[int]:
    """Every burst of up to `longest` bits in a CAN payload of 64 bits: first and last bit wrong, any between."""
    masks = []
    for first in range(64):
        for length in range(1, min(longest, 64 - first) + 1):
            ends = {first, first + length - 1}
            for inner in range(1 << max(length - 2, 0)):
                wrong = ends | {first + 1 + i for i in range(length - 2) if inner >> i & 1}
                masks.append(sum(wire_position(bit) for bit in wrong))
    return masks


def passing_errors(masks: list[int], seed: int) -> list[int]:
    """The errors that a frame with a right CRC survives, in C and in Python."""
    identifier, data = frames(1, seed)[0]
    value, c_crc8 = int.from_bytes(data, "little"), library().frames_crc8
    passed = []
    for mask in masks:
        damaged = (value ^ mask).to_bytes(8, "little")
        python_passes = check(identifier, damaged)
        assert python_passes == (c_crc8(identifier, 8, damaged) == damaged[0])
        if python_passes:
            passed.append(mask)
    return passed


@pytest.mark.parametrize("seed", [6, 60])
def test_every_burst_of_up_to_eight_bits_is_rejected(seed: int) -> None:
    masks = bursts(8)
    assert len(masks) == len(set(masks)) == 7423
    assert passing_errors(masks, seed) == []


def test_longer_bursts_do_pass_so_the_test_can_fail() -> None:
    """Of nine bits some burst must pass: the generator polynomial itself."""
    longer = set(bursts(9)) - set(bursts(8))
    assert len(passing_errors(sorted(longer), 6)) > 0


def test_every_one_two_and_three_bit_error_of_a_frame_is_rejected() -> None:
    # 64 bits of payload taken up to three at a time: linear, so one frame stands for all.
    bits = [1 << i for i in range(64)]
    masks = [sum(some) for count in (1, 2, 3) for some in combinations(bits, count)]
    assert len(masks) == 64 + 2016 + 41664
    assert passing_errors(masks, 6) == []


def test_every_three_bit_error_is_rejected() -> None:
    """The same with the identifier (11 bits) and the length (4 bits) among the bits that may be wrong."""
    identifier, data = frames(1, 9)[0]
    covered = [identifier >> 8, identifier & 0xFF, 8, *data[:0:-1]]
    right = _crc_by_bits(bytes(covered))
    # What one wrong bit changes in the CRC; several add up without carry, because the CRC is linear.
    places = [(0, i) for i in range(3)] + [(1, i) for i in range(8)] + [(2, i) for i in range(4)]
    places += [(3 + byte, i) for byte in range(7) for i in range(8)]
    changes = [1 << i for i in range(8)]
    for byte, bit in places:
        wrong = [*covered[:byte], covered[byte] ^ 1 << bit, *covered[byte + 1 :]]
        changes.append(_crc_by_bits(bytes(wrong)) ^ right)
    assert len(changes) == 79
    assert 0 not in changes
    assert len(set(changes)) == len(changes)
    sums = {a ^ b for a, b in combinations(changes, 2)}
    assert not sums & set(changes)


def test_another_identifier_or_length_is_rejected() -> None:
    identifier, data = frames(1, 7)[0]
    # A CRC of 8 bits lets one in 256 pass; the identifiers are a linear code, so that the count scatters little.
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
