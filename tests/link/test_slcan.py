"""Two parsers, one grammar: C and Python agree on any stream, and no stream keeps the next good line from them."""

from __future__ import annotations

import random

import pytest

from plumb.link.transports.slcan import SlcanParser, frame_of_line, text_of_frames
from plumb.spec.protocol import crc8
from support.link_functions import parse

ALPHABETS = [bytes(range(256)), b"t0123456789ABCDEFabcdef\r", b"t8\r\a\xff 0"]


def good(rng: random.Random) -> tuple[int, bytes]:
    identifier, body = rng.randrange(0x800), rng.randbytes(7)
    return identifier, bytes([crc8(identifier, b"\0" + body)]) + body


def damaged_stream(seed: int) -> bytes:
    """Frames, garbage and frames with damage, in no order."""
    rng = random.Random(seed)
    parts = []
    for _ in range(200):
        text = text_of_frames([good(rng)])
        kind = rng.randrange(6)
        if kind == 0:
            alphabet = rng.choice(ALPHABETS)
            text = bytes(rng.choice(alphabet) for _ in range(rng.randrange(60)))
        elif kind == 1:
            at = rng.randrange(len(text))
            text = text[:at] + rng.randbytes(rng.randrange(3)) + text[at + rng.randrange(3) :]
        elif kind == 2:
            text = text.lower()
        elif kind == 3:
            too_high = b"t8008" + b"0" * 16 + b"\r"
            text = rng.choice([b"\r", b"\a", b"V0101\r", b"z\r", b"t1230\r", b"t12321122\r", too_high])
        parts.append(text)
    return b"".join(parts)


@pytest.mark.parametrize("seed", range(150))
def test_c_and_python_find_the_same_frames(seed: int) -> None:
    stream = damaged_stream(seed) + b"\r"
    whole = SlcanParser()
    ours = whole.feed(stream)
    theirs, bad = parse(stream)
    assert ours == theirs
    assert whole.bad == bad
    # Split anywhere, nothing changes.
    rng = random.Random(seed + 1000)
    split, pieces, at = SlcanParser(), [], 0
    while at < len(stream):
        step = rng.choice([1, 1, 2, 7, 30, 500])
        pieces += split.feed(stream[at : at + step])
        at += step
    assert pieces == ours
    assert (split.bad, split.rejected, split.accepted, split.refused) == (
        whole.bad, whole.rejected, whole.accepted, whole.refused,
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(50))
def test_the_line_after_any_garbage_is_received(seed: int) -> None:
    rng = random.Random(seed)
    frame = good(rng)
    garbage = rng.randbytes(rng.randrange(300))
    stream = garbage + b"\r" + text_of_frames([frame])
    assert SlcanParser().feed(stream)[-1] == frame
    assert parse(stream)[0][-1] == frame


def test_an_endless_line_does_not_grow() -> None:
    parser = SlcanParser()
    for _ in range(1000):
        assert parser.feed(b"t" * 1000) == []
    assert len(parser._pending) < 100
    assert parser.feed(b"\r") == []
    assert parser.bad == 1


def test_what_is_counted() -> None:
    parser = SlcanParser()
    frame = good(random.Random(1))
    spoiled = (frame[0], frame[1][:-1] + bytes([frame[1][-1] ^ 1]))
    short = b"t1237" + b"00" * 7 + b"\r"
    assert parser.feed(b"\r\r\aV0101\r" + text_of_frames([frame, spoiled]) + short + b"t12\r\xff\r") == [frame]
    assert (parser.accepted, parser.refused, parser.rejected, parser.bad) == (2, 1, 2, 2)
    assert list(parser.answers) == [b"V0101"]


@pytest.mark.parametrize("count", [1, 4, 5, 40])
def test_one_bad_frame_among_whole_lines(count: int) -> None:
    """All lines of the usual shape are looked at together: the odd one out must not slip through."""
    rng = random.Random(count)
    frames = [good(rng) for _ in range(count)]
    spoiled = (frames[0][0], frames[0][1][:-1] + bytes([frames[0][1][-1] ^ 1]))
    body = rng.randbytes(7)
    too_high = (0x923, bytes([crc8(0x923, b"\0" + body)]) + body)
    for odd in (spoiled, too_high):
        for at in (0, count // 2, count):
            lines = [*frames[:at], odd, *frames[at:]]
            parser = SlcanParser()
            assert parser.feed(text_of_frames(lines)) == frames
            assert parser.rejected + parser.bad == 1


@pytest.mark.parametrize(
    "line", [b"", b"t", b"t123", b"t1239", b"t8000", b"t12g0", b"t123100", b"t 230", b"T12345678800", b"t123\xb20"]
)
def test_lines_that_are_no_frames(line: bytes) -> None:
    assert (frame_of_line(line) is not None) == (line == b"t123100")
