"""What an image holds of the parameter table: the groups that its systems read; all else is a constant with its number.

The table and the store of an image are built for this machine, as tools/generate.py writes them for it.
"""

from __future__ import annotations

import ctypes
import random
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from plumb.link.identity import Identity, nack_error
from plumb.spec import declarations, images, parameters, protocol
from plumb.spec.parameters import Parameter

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware"
ROWS = parameters.table()
COUNT = len(ROWS)
ALONE = [image for image in images.images().values() if len(image.systems) == 1]
SMALLEST = min(ALONE, key=lambda image: len(images.held_groups(image.systems)))
LOADED = 1
"""STORE_LOADED of firmware/link/store.h."""


class Report(ctypes.Structure):
    """store_report_t"""

    _fields_ = (
        ("found", ctypes.c_int),
        ("sequence", ctypes.c_uint32),
        ("unknown", ctypes.c_uint16),
        ("missing", ctypes.c_uint16),
    )


class Tables:
    """Parameter table and store of an image; a table is memory with room for every word."""

    def __init__(self, folder: Path, image: images.Image) -> None:
        made, path = folder / "made", folder / "tables.so"
        generate: list[str | Path] = [sys.executable, ROOT / "tools" / "generate.py", "--out", made, "--flash"]
        subprocess.run([*generate, f"--systems={';'.join(image.systems)}"], check=True)
        sources = [made / "generated" / name for name in ("params.c", "systems.c")]
        sources += [FIRMWARE / "link/store.c", FIRMWARE / "ports/native/flash.c", *(FIRMWARE / "core").glob("*.c")]
        for system in declarations.with_bases(image.systems):
            sources += [FIRMWARE / "systems" / f"{system.name}.c", *(FIRMWARE / "systems").glob(f"{system.name}_*.c")]
        includes = [f"-I{place}" for place in (made, made / "include", FIRMWARE, FIRMWARE / "include")]
        flags = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror", "-shared", "-fPIC"]
        flags += ["-fsanitize=undefined", "-fsanitize-undefined-trap-on-error", "-Wl,-Bsymbolic"]
        subprocess.run(["cc", *flags, *includes, *sources, "-o", path], check=True)
        self.c = ctypes.CDLL(str(path))
        for name in ("params_word", "params_crc32"):
            getattr(self.c, name).restype = ctypes.c_uint32
        for name in ("params_held", "params_fixed_change", "params_unsafe"):
            getattr(self.c, name).restype = ctypes.c_uint16
        for name in ("params_in_range", "store_accepts", "store_save"):
            getattr(self.c, name).restype = ctypes.c_bool
        self.c.store_load.restype = Report
        groups = images.held_groups(image.systems)
        self.ways = image.ways
        self.held = [i for i, row in enumerate(ROWS) if not row.group or row.group in groups]
        self.flash = (ctypes.c_uint8 * (2 * 2 * 1024)).in_dll(self.c, "flash")

    def default(self) -> ctypes.Array[ctypes.c_uint32]:
        table = (ctypes.c_uint32 * COUNT)()
        self.c.params_default(table)
        return table

    def words(self, table: ctypes.Array[ctypes.c_uint32]) -> list[int]:
        return [int(self.c.params_word(table, i)) for i in range(COUNT)]

    def crc(self, table: ctypes.Array[ctypes.c_uint32]) -> int:
        return int(self.c.params_crc32(table))

    def takes(self, index: int, value: int) -> bool:
        return bool(self.c.params_in_range(index, ctypes.c_uint32(value & 0xFFFFFFFF)))

    def set(self, table: ctypes.Array[ctypes.c_uint32], index: int, value: int) -> None:
        self.c.params_set_word(table, index, ctypes.c_uint32(value & 0xFFFFFFFF))


@pytest.fixture(scope="module", params=ALONE, ids=lambda image: str(image.name))
def alone(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Tables:
    return Tables(tmp_path_factory.mktemp("alone"), request.param)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Tables:
    return Tables(tmp_path_factory.mktemp("whole"), images.of_systems(declarations.names()))


def factory(tables: Tables) -> list[int]:
    """The factory values of an image: of the table, but the system is the first that it has."""
    system = tables.c.params_word(tables.default(), 0)
    return [system, *(row.default & 0xFFFFFFFF for row in ROWS[1:])]


def moved(row: Parameter) -> int:
    """A value in range that is not the factory one."""
    return row.default - 1 if row.default > row.min else row.default + 1


def test_an_image_of_all_systems_holds_all(whole: Tables) -> None:
    assert whole.held == list(range(COUNT))
    assert images.held_groups(declarations.names()) == {row.group for row in ROWS if row.group}


def test_an_image_holds_what_its_systems_read_and_the_outputs(alone: Tables) -> None:
    assert [alone.c.params_held(place) for place in range(len(alone.held) + 2)] == [*alone.held, COUNT, COUNT]
    everywhere = {i for i, row in enumerate(ROWS) if row.owner == "link" and not row.part}
    assert 0 in alone.held and everywhere <= set(alone.held)
    assert len(alone.held) < COUNT


def test_a_held_word_is_as_in_an_image_of_all(alone: Tables, whole: Tables) -> None:
    mine, every, chance = alone.default(), whole.default(), random.Random(5)
    whole.set(every, 0, alone.words(mine)[0])
    for index in alone.held[1:]:
        row, above = ROWS[index], ROWS[index].max + 1
        if row.name == "accel_bus" and alone.ways < whole.ways:
            assert not alone.takes(index, alone.ways) and whole.takes(index, alone.ways)
            row = replace(row, max=alone.ways - 1)
        for value in (row.min, row.max, row.min - 1, above, chance.randint(-(1 << 31), (1 << 32) - 1)):
            assert alone.takes(index, value) == whole.takes(index, value), (row.name, value)
        for tables, table in ((alone, mine), (whole, every)):
            tables.set(table, index, moved(row))
    assert alone.words(mine) == whole.words(every)
    assert alone.crc(mine) == whole.crc(every) == parameters.crc32(alone.words(mine))
    assert alone.c.params_unsafe(mine) == whole.c.params_unsafe(every)
    for index in alone.held[1:]:
        one, other = alone.default(), whole.default()
        alone.set(one, index, ROWS[index].min)
        whole.set(other, index, ROWS[index].min)
        same = whole.default()
        whole.set(same, 0, alone.words(one)[0])  # some conditions are those of a system
        whole.set(same, index, ROWS[index].min)
        assert alone.c.params_unsafe(one) == whole.c.params_unsafe(same), ROWS[index].name
        for near in (None, (ctypes.c_int32 * COUNT)()):
            changes = [t.c.params_fixed_change(t.default(), table, near) for t, table in ((alone, one), (whole, other))]
            assert changes[0] == changes[1], ROWS[index].name


def test_a_word_that_is_not_held_is_its_factory_value(alone: Tables) -> None:
    table, before = alone.default(), factory(alone)
    assert alone.words(table) == before
    for index in set(range(COUNT)) - set(alone.held):
        row = ROWS[index]
        assert alone.takes(index, row.default)
        assert not any(alone.takes(index, value) for value in {row.min, row.max, moved(row)} - {row.default})
        alone.set(table, index, moved(row))
    assert alone.words(table) == before and alone.crc(table) == parameters.crc32(before)


def test_the_crc_is_that_of_the_whole_table_in_order(alone: Tables) -> None:
    table, chance = alone.default(), random.Random(7)
    for _ in range(20):
        for index in alone.held:
            alone.set(table, index, chance.getrandbits(32))
        assert alone.crc(table) == parameters.crc32(alone.words(table))


def save(tables: Tables, system: int) -> list[int]:
    """The words of a set for this system that an image saved in its flash: every held one moved where it may be."""
    table, sequence = tables.default(), ctypes.c_uint32()
    tables.set(table, 0, system)
    for index in tables.held[1:]:
        tables.set(table, index, moved(ROWS[index]))
        if not tables.c.store_accepts(table):
            tables.set(table, index, ROWS[index].default)
    tables.c.flash_blank()
    for _ in range(2):  # the second time it is saved already
        assert tables.c.store_save(table, ctypes.byref(sequence)) and sequence.value == 1
    return tables.words(table)


def load(tables: Tables, flash: ctypes.Array[ctypes.c_uint8]) -> tuple[list[int], list[int]]:
    """What was found, how many values are unknown and missing, and the words that an image loads from that flash."""
    ctypes.memmove(tables.flash, flash, len(flash))
    table = tables.default()
    report = tables.c.store_load(table)
    return [report.found, report.unknown, report.missing], tables.words(table)


def test_a_set_of_another_image_loads_with_what_both_hold(alone: Tables, whole: Tables) -> None:
    system, others = factory(alone)[0], set(range(COUNT)) - set(alone.held)
    for writer, reader, found in (
        (whole, alone, [LOADED, len(others), 0]),
        (alone, whole, [LOADED, 0, len(others)]),
        (alone, alone, [LOADED, 0, 0]),
    ):
        wanted = save(writer, system)
        for index in others:
            wanted[index] = ROWS[index].default & 0xFFFFFFFF
        assert load(reader, writer.flash) == (found, wanted)
        assert sum(wanted[i] != ROWS[i].default & 0xFFFFFFFF for i in alone.held) > len(alone.held) // 2


def identity(systems: Sequence[str]) -> Identity:
    return Identity({"SYSTEMS": sum(1 << declarations.system(name).number for name in systems)}, None)


def test_the_refusal_of_what_is_not_held_says_which_image_holds_it() -> None:
    mine = protocol.protocol()
    said = {"request": mine["PARAM_SET"].identifier, "reason": mine["NACK"].value("reason", "RANGE")}
    groups = images.held_groups(SMALLEST.systems)
    index = next(i for i, row in enumerate(ROWS) if row.group and row.group not in groups)
    row = ROWS[index]
    text = str(nack_error(mine, {**said, "detail": index}, identity(SMALLEST.systems)))
    assert f"has only {SMALLEST.name}, and does not hold the parameters of {row.group}" in text
    assert f"{row.name} stays at its factory value, {row.default}" in text and "outside" not in text
    flashed = images.image(text.partition("--image ")[2].split()[0])
    assert row.group in images.held_groups(flashed.systems) and set(SMALLEST.systems) < set(flashed.systems)
    for known in (None, identity(declarations.names()), identity(())):
        assert "is outside" in str(nack_error(mine, {**said, "detail": index}, known))
