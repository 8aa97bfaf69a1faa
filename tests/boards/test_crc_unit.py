"""The image's digest by the chip's CRC unit: CRC-32 as zlib computes it, of any bytes at any address."""

from __future__ import annotations

import random
import re
import zlib
from pathlib import Path

import pytest

pytest.importorskip("unicorn")
pytest.importorskip("capstone")

from plumb.bench.instruction_counter import Counter, Image
from plumb.flash.call_graph import CallGraph

BUILD = Path(__file__).parents[2] / "build/stm32f103"
DIGEST = "digest_crc32"
PORTABLE_CYCLES = 2412
"""Of the digest of 160 bytes by core/digest.c, with its table in flash."""

pytestmark = pytest.mark.skipif(
    not (BUILD / "firmware.elf").exists(), reason="the flash image is not built: run make image"
)


@pytest.fixture(scope="module")
def image() -> Image:
    return Image(BUILD / "firmware.elf")


def test_digests_of_every_length_and_address_are_zlibs(image: Image) -> None:
    counter, chance = Counter(image), random.Random(43)
    place = counter.place(bytes(256))
    for count in [*range(70), 160, 200]:
        for offset in range(4):
            data = chance.randbytes(count)
            counter.write(place + offset, data)
            assert counter.call(DIGEST, place + offset, count).result == zlib.crc32(data), (count, offset)


def test_the_unit_takes_a_fifth_of_the_portable_digests_time_at_most(image: Image) -> None:
    counter = Counter(image)
    assert counter.call(DIGEST, counter.place(bytes(160)), 160).cost.cycles_2ws < PORTABLE_CYCLES / 5
    assert counter.call(DIGEST, counter.place(bytes(160)), 160).cost.cycles < 400


def test_the_portable_digest_is_not_in_the_image(image: Image) -> None:
    assert DIGEST in image.symbols and "remainder_of" not in image.symbols


def test_no_interrupt_uses_the_unit(image: Image) -> None:
    """It keeps one remainder."""
    graph, digest = CallGraph(image.path), image.symbol(DIGEST).address & ~1
    vectors = [address & ~1 for address in image.vectors()[2:]]
    assert digest in graph.reachable(image.symbol("loop_turn").address & ~1)
    assert not [graph.name(start) for start in set(vectors) if start and digest in graph.reachable(start)]
    port = (BUILD.parents[1] / "firmware/ports/stm32f103").glob("*.c")
    users = [path.name for path in port if re.search(r"\bCRC_DR\b", path.read_text(encoding="utf-8"))]
    assert users == ["crc.c"]
