"""Frames of a receiver, found in any stream by the firmware's parser and by a second one; and sticks and switches."""

from __future__ import annotations

import ctypes
import random
from dataclasses import replace
from itertools import combinations

import pytest

from plumb.spec import crsf, declarations
from plumb.systems.quadrotor import scenarios
from support import link_functions
from support.receiver_twin import LENGTHS, by_firmware, by_twin

GAP = bytes(64)
"""Separates frames: nothing before it is waited for behind it."""
LATEST = 62
"""Bytes by which a frame may be found late, behind a false length."""
VALUES = [3, 172, 500, 992, 1500, 1811, 2047, 0, 700, 701, 1023, 1024, 1, 2, 800, 1600]
CHECKED_BITS = range(16, 208)
"""Bits of a frame of channels that its CRC covers: type, payload, CRC."""


def flipped(frame: bytes, *bits: int) -> bytes:
    whole = int.from_bytes(frame, "big")
    for bit in bits:
        whole ^= 1 << 8 * len(frame) - 1 - bit
    return whole.to_bytes(len(frame), "big")


def drawn(chance: random.Random) -> bytes:
    """A frame that a receiver may send."""
    if chance.random() < 0.3:
        return crsf.statistics(chance.choice([0, 1, 50, 100]))
    return crsf.channels([chance.choice([172, 992, 1811, chance.randrange(2048)]) for _ in range(16)])


def damaged(chance: random.Random) -> bytes:
    """Frames with pieces missing, changed, repeated, and with bytes that look like frames between them."""
    stream = bytearray()
    for _ in range(chance.randrange(1, 12)):
        frame = bytearray(drawn(chance))
        way = chance.randrange(8)
        if way == 0:
            del frame[chance.randrange(len(frame)) :]
        elif way == 1:
            del frame[: chance.randrange(len(frame))]
        elif way == 2:
            frame[chance.randrange(len(frame))] ^= 1 << chance.randrange(8)
        elif way == 3:
            frame = bytearray(chance.randbytes(chance.randrange(70)))
        elif way == 4:
            kind = chance.choice(list(LENGTHS))
            frame = bytearray([crsf.SYNC, LENGTHS[kind] - 2, kind, *chance.randbytes(chance.randrange(26))])
        elif way == 5:
            frame = bytearray(chance.choices([crsf.SYNC, 24, 12, crsf.STICKS, crsf.STATISTICS, 0], k=40))
        elif way == 6:
            frame = bytearray(crsf.frame(chance.choice([0x02, 0x08, 0x1E, 0x29, 0x2B]), chance.randbytes(20)))
        stream += frame
    return bytes(stream)


def test_a_frame_of_channels_is_what_the_protocol_says() -> None:
    """By hand: sixteen times 992, 0x3E0, whose pattern of bits repeats every 11 bytes."""
    pattern = bytes([0xE0, 0x03, 0x1F, 0xF8, 0xC0, 0x07, 0x3E, 0xF0, 0x81, 0x0F, 0x7C])
    frame = crsf.channels([])
    assert frame[:3] == b"\xc8\x18\x16" and frame[3:-1] == 2 * pattern and crsf.crc8(b"123456789") == 0xBC
    (row,) = by_firmware(crsf.channels(VALUES))
    assert list(row.channels) == VALUES
    (row,) = by_firmware(crsf.statistics(87))
    assert row.link_quality == 87


def agree(stream: bytes) -> None:
    """The firmware finds the same frames; one inside what only looked like a longer frame as that is over."""
    firmware, twin = by_firmware(stream + GAP), by_twin(stream + GAP)
    assert all(0 <= one.end - other.end <= LATEST for one, other in zip(firmware, twin, strict=True))
    assert firmware == [replace(row, end=one.end) for row, one in zip(twin, firmware, strict=True)]


@pytest.mark.parametrize("seed", range(40))
def test_both_parsers_agree_on_any_stream(seed: int) -> None:
    chance = random.Random(seed)
    stream = b"".join(damaged(chance) for _ in range(60))
    agree(stream)
    for _ in range(20):
        agree(damaged(chance)[: chance.randrange(400)])


def test_a_whole_frame_is_found_whatever_came_before() -> None:
    """At most 62 bytes late, unless the bytes before it look like a frame with the right CRC: those are counted."""
    chance = random.Random(7)
    missed = 0
    for _ in range(3000):
        values = [chance.randrange(2048) for _ in range(16)]
        before, frame = damaged(chance)[:300], crsf.channels(values)
        late = [
            row.end - len(before) - len(frame)
            for row in by_firmware(before + frame + GAP)
            if list(row.channels) == values
        ]
        assert all(0 <= one <= LATEST for one in late[-1:])
        missed += not late
    assert missed < 30


@pytest.mark.parametrize("kind", [0x7A, 0x7B, 0x29, 0x2B, crsf.STICKS, crsf.STATISTICS])
def test_a_frame_inside_the_payload_of_another_is_not_obeyed(kind: int) -> None:
    """MSP and parameters carry any bytes, a frame of channels among them."""
    inner = crsf.channels([992, 992, 1811, 992, 1811])
    for around in range(0, 30):
        outer = crsf.frame(kind, bytes(around) + inner + bytes(30 - around))
        assert [row.words for row in by_firmware(outer + GAP)] == [], around
    (row,) = by_firmware(outer + crsf.channels(VALUES))
    assert list(row.channels) == VALUES


@pytest.mark.parametrize("length", range(256))
def test_a_false_length_costs_two_frames_at_most(length: int) -> None:
    good = [crsf.channels([172 + k]) for k in range(6)]
    rows = by_firmware(bytes([crsf.SYNC, length]) + b"".join(good))
    found = [row.channels[0] - 172 for row in rows]
    assert found == list(range(6))[6 - len(found) :], "by chance the CRC agrees, and two are inside"
    assert len(found) >= 4
    prompt = [row.channels[0] - 172 for row in rows if (row.end - 2) % 26 == 0]
    assert prompt[-4:] == [2, 3, 4, 5] or prompt[-3:] == [3, 4, 5]


def test_wrong_bits_alone_and_in_bursts_are_all_found() -> None:
    frame = crsf.channels(VALUES)
    bursts = [(0,), *((0, *inner, width) for width in range(1, 8) for inner in _subsets(range(1, width)))]
    assert len(bursts) == 128
    for whole in (frame, crsf.statistics(0)):
        wrong = [
            flipped(whole, *(at + bit for bit in burst)) for burst in bursts for at in range(8 * len(whole) - burst[-1])
        ]
        assert by_firmware(GAP.join(wrong)) == []
    odd = [flipped(frame, *random.Random(k).sample(CHECKED_BITS, 3 + 2 * (k % 5))) for k in range(20_000)]
    assert by_firmware(GAP.join(odd)) == []


def _subsets(bits: range) -> list[tuple[int, ...]]:
    return [chosen for count in range(len(bits) + 1) for chosen in combinations(bits, count)]


def test_of_all_pairs_of_wrong_bits_105_pass() -> None:
    """Among those that the CRC covers; where one of them is in the type, it is a frame that does not count."""
    frame = crsf.channels(VALUES)
    pairs = list(combinations(CHECKED_BITS, 2))
    wrong = {pair: flipped(frame, *pair) for pair in pairs}
    passed = [pair for pair, bytes_ in wrong.items() if crsf.crc8(bytes_[2:-1]) == bytes_[-1]]
    assert (len(pairs), len(passed)) == (18_336, 105)
    counted = [pair for pair in passed if pair[0] >= 24]
    assert len(by_firmware(GAP.join(wrong.values()))) == len(counted) == 91


def test_noise_passes_once_in_256_of_what_looks_like_a_frame() -> None:
    chance = random.Random(1)
    frames = 40_000
    stream = b"".join(b"\xc8\x18\x16" + chance.randbytes(23) + GAP for _ in range(frames))
    assert len(by_firmware(stream)) == pytest.approx(frames / 256, abs=40)
    noise = chance.randbytes(1_000_000)
    agree(noise)
    assert len(by_firmware(noise)) <= 1


def test_sticks_and_throttle_over_the_whole_range() -> None:
    stream = b"".join(crsf.channels([value] * 4) for value in range(2048))
    rows = by_firmware(stream)
    assert rows == by_twin(stream)
    throttle, roll, pitch, yaw, *_ = zip(*(row.words for row in rows), strict=True)
    assert (roll, pitch) == (tuple(-value for value in yaw),) * 2
    assert [roll[at] for at in (0, 172, 992, 1811, 2047)] == [-32767, -32767, 0, 32767, 32767]
    assert [throttle[at] for at in (0, 172, 1811, 2047)] == [0, 0, 32767, 32767]
    assert list(roll) == sorted(roll) and list(throttle) == sorted(throttle)


def test_a_switch_needs_three_equal_frames_in_a_row() -> None:
    def switched(*values: int) -> list[int]:
        rows = by_firmware(b"".join(crsf.channels([992, 992, 172, 992, value]) for value in values))
        return [row.words[4] for row in rows]

    assert switched(1811, 1811, 1811, 172, 172, 172) == [0, 0, 1, 1, 1, 0]
    assert switched(1811, 1811, 172, 1811, 1811, 1811) == [0, 0, 0, 0, 0, 1]
    assert switched(1811, 1811, 992, 1811, 1811) == [0] * 5, "between the two it asks for the present one"
    assert switched(1193, 1193, 1193, 792, 792, 792, 792) == [0, 0, 1, 1, 1, 1, 1]
    assert switched(1192, 1192, 1192, 1193, 1193, 1193, 791, 791, 791) == [0, 0, 0, 0, 0, 1, 1, 1, 0]
    rate = by_firmware(b"".join(crsf.channels([992, 992, 172, 992, 172, 1811]) for _ in range(3)))
    assert [row.words[4] for row in rate] == [0, 0, 2]


def test_frames_are_numbered_in_a_circle_without_0() -> None:
    rows = by_firmware(b"".join(crsf.channels([]) for _ in range(300)))
    assert [row.words[5] for row in rows] == [k % 255 + 1 for k in range(300)]


def test_a_transmitter_that_is_lost_moves_nothing() -> None:
    here, there = [1400, 700, 1000, 800, 1811], [172, 172, 1811, 172, 172]
    stream = b"".join(
        [*[crsf.channels(here)] * 3, crsf.statistics(0), *[crsf.channels(there)] * 4, crsf.statistics(1),
         crsf.channels(there)]
    )  # fmt: skip
    rows = by_firmware(stream)
    assert [row.words[5] for row in rows] == [1, 2, 3, 3, 3, 3, 3, 3, 3, 4], "its frames count as missing"
    assert {row.words[:5] for row in rows[2:9]} == {rows[2].words[:5]}
    assert rows[9].words[0] == 32767 and rows[9].words[4] == 1, "one frame turns no switch"


@pytest.mark.parametrize("name", ["sticks", "lost"])
def test_the_frames_of_a_scenario_bring_its_inputs_back(name: str) -> None:
    """To within the resolution of a channel, 40 of 32767; a switch three frames later; the number counts on."""
    scenario = scenarios.scenario(name, 1000, seconds=11.0)
    counts = declarations.system("quadrotor").counts
    commands, throttles = scenario.counts()[:, counts:], scenario.setpoint()
    pilot, stream, ends = crsf.Pilot(), b"", []
    for throttle, words in zip(throttles.tolist(), commands.tolist(), strict=True):
        stream += pilot.frames(throttle, words)
        ends.append(len(stream))
    rows = iter([*by_firmware(stream), None])
    row, following = None, next(rows)
    worst, lost = 0, []
    for end, throttle, words in zip(ends, throttles.tolist(), commands.tolist(), strict=True):
        while following is not None and following.end <= end:
            row, following = following, next(rows)
        if row is None or row.words[5] & 256:
            lost.append(bool(words[4] & 256))
            continue
        worst = max(worst, *(abs(a - b) for a, b in zip(row.words[:4], [max(throttle, 0), *words[:3]], strict=True)))
        assert row.words[5] == words[4] and row.words[5] & 255
    assert 0 < worst <= 40 and all(lost)


def test_a_frame_of_inputs_has_the_signs_of_the_commands() -> None:
    rows = by_firmware(3 * crsf.of_inputs(8000, 1000, -2000, 3000, 3))
    assert rows[-1].words[:4] == pytest.approx((8000, 1000, -2000, 3000), abs=40) and rows[-1].words[4] == 3


def test_a_parser_whose_counts_were_damaged_writes_nowhere_else_and_takes_the_next_frame() -> None:
    """Its memory has no check word: a flipped bit in it is as one on the line, and must stay so."""
    stream, harmed = crsf.sticks() * 2, ctypes.c_uint32()
    for length in (0, 1, 2, 25, 26, 27, 28, 64, 128, 255):
        for used in (0, 1, 14, 26, 27, 64, 128, 255):
            count = link_functions.library().crsf_after_damage(
                ctypes.c_uint8(length), ctypes.c_uint8(used), stream, ctypes.c_size_t(len(stream)), ctypes.byref(harmed)
            )
            assert count >= 1 and harmed.value == 0, (length, used)
