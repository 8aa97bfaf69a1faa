"""Readers of foreign files against files that are hostile by structure: every one ends in time, with one sentence or a
result, and within its memory. The files come from a seed: `tests/support/hostile_files.py`."""

from __future__ import annotations

import os
import random
import re
import struct
import tempfile
import zipfile
from collections.abc import Callable
from functools import cache
from io import BytesIO
from pathlib import Path

import pytest

from plumb.boards.flash_file import read_slots
from plumb.cli.questions import Answers
from plumb.errors import UsageError
from plumb.files import settings, toml_text
from plumb.flash import packaged_images
from plumb.flash.elf import Elf
from plumb.flash.image import find_image, load_own_image
from plumb.link import parameter_history
from plumb.link.transports.open_bus import LogBus
from plumb.proof import golden_manifest, golden_recipe
from plumb.proof.golden_file import Vector
from plumb.readers import recording
from plumb.readers.log_replay import chosen, open_log, runs_of
from plumb.spec import parameter_file, parameters
from plumb.tuning import quantities_file
from plumb.writers import log_export
from support import hostile_files
from support.campaigns import campaign
from support.hostile_trial import BLOCK, WHOLE, try_block
from support.recordings import recorded_run

VECTORS = Path(__file__).resolve().parents[1] / "vectors"


@cache
def good_table() -> dict[str, int]:
    return {row.name: row.default for row in parameters.table()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good log, in every format that is made from one."""
    made = tmp_path_factory.mktemp("good")
    log = recorded_run(made / "good.plog")
    opened = open_log(log)
    log_export.export(opened, chosen(runs_of(opened), None), made / "good.mf4")
    return made


def of_log(path: Path) -> None:
    runs_of(open_log(path))


def of_bus(path: Path) -> None:
    bus = LogBus(path)
    try:
        for _ in range(3):
            bus.recv(0.0)
    finally:
        bus.shutdown()


def of_settings(path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(settings, "settings_file", lambda: path)
        settings.read()


def of_quantities(path: Path) -> None:
    if quantities_file.is_in_units(path):
        quantities_file.wanted(quantities_file.read_text(path), str(path), good_table())


def of_manifest(path: Path) -> None:
    golden_manifest.read(path.parent)


def of_linked(path: Path) -> None:
    found = Elf(path)
    found.vectors()
    for function in found.functions:
        found.code_of(function)
    assert len(found.symbols) and found.limits and found.flash_bytes


def of_images(path: Path) -> None:
    for image in packaged_images.packaged_images(path.parent).values():
        image.verify()


def of_history(path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parameter_history, "file_of", lambda _: path)
        parameter_history.read("0")


def of_recording(path: Path) -> None:
    """By the readers of plumb's own: they know by themselves what is wrong, before a limit ends them."""
    try:
        recording.load(path)
    except UsageError as error:
        assert not re.search(r"is damaged, or no \S+ file \(|its reader failed|takes longer", str(error)), error
        raise


def of_folder(path: Path) -> None:
    """The files of a zip, in a folder; a pipe is one that nobody may open."""
    if not path.is_file():
        raise UsageError("no file")
    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        of_recording(Path(folder))


def _zip_of(files: dict[str, bytes]) -> bytes:
    out = BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return out.getvalue()


Make = Callable[[random.Random, Path], bytes]
Read = Callable[[Path], object]


def _table_text() -> str:
    return "[values]\n" + "\n".join(f"{name} = {value}" for name, value in good_table().items())


@cache
def _vector() -> bytes:
    return min(VECTORS.glob("*.golden"), key=lambda path: path.stat().st_size).read_bytes()


FORMATS: dict[str, tuple[str, Make, Read]] = {
    "blf": ("a.blf", lambda rng, _: hostile_files.blf(rng), of_log),
    "asc": ("a.asc", lambda rng, _: hostile_files.asc(rng), of_log),
    "candump": ("a.log", lambda rng, _: hostile_files.candump(rng), of_log),
    "trc": ("a.trc", lambda rng, _: hostile_files.trc(rng), of_log),
    "mf4": ("a.mf4", lambda rng, good: hostile_files.mf4(rng, (good / "good.mf4").read_bytes()), of_log),
    "frames in text": ("a.log", lambda rng, _: hostile_files.console_text(rng), of_log),
    "frames in csv": ("a.csv", lambda rng, _: hostile_files.bus_csv(rng), of_bus),
    "plog": ("a.plog", lambda rng, _: hostile_files.plog(rng, {"clock": "utc", "protocol": {}}, good_table()), of_log),
    "npz": ("a.npz", lambda rng, _: hostile_files.npz(rng), recording.load),
    "csv": ("a.csv", lambda rng, _: hostile_files.recording_csv(rng), recording.load),
    "ulog": ("a.ulg", lambda rng, _: hostile_files.ulog(rng), of_recording),
    "zip of tables": ("a.zip", lambda rng, _: hostile_files.zip_of_tables(rng), recording.load),
    "folder of tables": ("a.zip", lambda rng, _: _zip_of(hostile_files.table_set(rng)), of_folder),
    "printed": ("a.txt", lambda rng, _: hostile_files.printed(rng), of_recording),
    "parameters": ("a.toml", lambda rng, _: hostile_files.toml(rng, _table_text()), parameter_file.read),
    "quantities": (
        "a.toml",
        lambda rng, _: hostile_files.toml(rng, quantities_file.text_of(good_table(), "good")),
        of_quantities,
    ),
    "settings": ("a.toml", lambda rng, _: hostile_files.toml(rng, 'board = "virtual"\nport = "x"'), of_settings),
    "answers": ("a.toml", lambda rng, _: hostile_files.toml(rng, 'write = true\nboard = "b"'), Answers),
    "recipe": (
        "recipe.toml",
        lambda rng, _: hostile_files.toml(rng, golden_recipe.files(VECTORS)[0].read_text(encoding="utf-8")),
        golden_recipe.read_file,
    ),
    "golden": ("a.golden", lambda rng, _: hostile_files.golden(rng, _vector()), Vector.read),
    "manifest": (
        "manifest.json",
        lambda rng, _: hostile_files.manifest(rng, (VECTORS / "manifest.json").read_bytes()),
        of_manifest,
    ),
    "elf": ("a.elf", lambda rng, _: hostile_files.elf(rng, hostile_files.good_elf()), load_own_image),
    "linked elf": (
        "firmware.elf",
        lambda rng, _: hostile_files.linked_elf(rng, find_image(None).with_suffix(".elf").read_bytes()),
        of_linked,
    ),
    "images": (packaged_images.MANIFEST, lambda rng, _: hostile_files.images(rng), of_images),
    "history": ("0.jsonl", lambda rng, _: hostile_files.history(rng, good_table()), of_history),
    "slots": ("slots", lambda rng, _: hostile_files.spoilt(rng, bytes(4096)), read_slots),
    "hex": ("a.hex", lambda rng, _: hostile_files.ihex(rng, hostile_files.good_image()), load_own_image),
    "bin": ("a.bin", lambda rng, _: hostile_files.spoilt(rng, hostile_files.good_image()), load_own_image),
}
"""Format -> name of the file, what makes a hostile one, what reads it."""


@pytest.mark.slow
@pytest.mark.parametrize("block", range(campaign(1, WHOLE // BLOCK)))
@pytest.mark.parametrize("name", FORMATS)
def test_a_hostile_file_is_one_sentence_or_a_result(name: str, block: int, folder: Path, tmp_path: Path) -> None:
    """No other exception, no minutes, no gigabytes, and no temporary file that stays."""
    called, make, read = FORMATS[name]
    try_block(tmp_path / called, block, lambda seed: make(random.Random(f"{name} {seed}"), folder), read)


@pytest.mark.parametrize("line", ["a" * 60_000, "a " * 30_000, "a:" * 30_000, "a" + " " * 60_000, "x=1" * 20_000])
def test_a_long_line_of_a_serial_port_is_read_in_time(line: str, tmp_path: Path) -> None:
    """A label without end, searched from each of its letters, took a minute."""
    path = tmp_path / "a.txt"
    path.write_text("Accel X: 1, Y: 2, Z: 9 g\nGyro X: 4, Y: 5, Z: 6 deg/s\n" + (line + "\n") * 3, encoding="utf-8")
    with pytest.raises(UsageError, match="names no time: give --units"):
        of_recording(path)


def test_a_field_with_a_line_break_is_reported_on_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    head = "time_s," + ",".join(
        f"{kind}_{axis}_{unit}" for kind, unit in (("gyr", "dps"), ("acc", "g")) for axis in "xyz"
    )
    path.write_text(head + '\n0,1,2,3,0,0,"x\n2"\n', encoding="utf-8")
    with pytest.raises(UsageError, match=r"^a.csv line \d: .* is no number$") as refused:
        recording.load(path)
    assert "\n" not in str(refused.value)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("name", sorted(FORMATS.keys() - {"images"}))  # a package may lack them, so a pipe is none
def test_a_pipe_is_refused_before_it_is_opened(name: str, tmp_path: Path) -> None:
    """Nobody ever writes into it: whoever opened it would wait for ever."""
    called, _, read = FORMATS[name]
    os.mkfifo(tmp_path / called)
    with pytest.raises(UsageError):
        read(tmp_path / called)


@pytest.mark.parametrize("table", ["segments", "symbols"])
def test_an_elf_file_whose_tables_repeat_the_whole_file_is_refused_at_once(table: str, tmp_path: Path) -> None:
    """65,535 headers in a file of a few megabytes, each of which takes a MiB of zeros: gigabytes, or hours."""
    data = bytearray(hostile_files.good_elf())
    zeros_at = len(data)
    data += bytes(1 << 20)
    head = {
        "segments": struct.pack("<8I", 1, zeros_at, 0x08000000, 0x08000000, 1 << 20, 1 << 20, 5, 4),
        "symbols": struct.pack("<10I", 0, 2, 2, 0, zeros_at, 1 << 20, 0, 0, 4, 16),
    }[table]
    count_at, start_at = (44, 28) if table == "segments" else (48, 32)
    struct.pack_into("<I", data, start_at, len(data))
    struct.pack_into("<H", data, count_at, 65535)
    path = tmp_path / "a.elf"
    path.write_bytes(bytes(data) + head * 65535)
    with pytest.raises(UsageError, match="is damaged"):
        Elf(path)


@pytest.mark.parametrize(
    "text",
    [
        ".".join("a" * 30_000) + " = 1",
        "[" + ".".join(["'a.b'"] * 10_000) + "]",
        " . ".join(['"\\""'] * 10_000) + " = 1",
        "x = { " + ".".join("a" * 10_000) + " = 1 }",
        "x = 'a' # '\n" + ".".join("a" * 10_000) + " = 1",
        'x = """\n" """\n' + ".".join("a" * 10_000) + " = 1",
        "x = " + "[" * 100_000,
        "x = " + "9" * 10_000,
    ],
)
def test_toml_that_would_take_hours_is_refused_at_once(text: str) -> None:
    """tomllib takes a second for a key of 10,000 parts, and a hundred times as long for ten times as many."""
    with pytest.raises(ValueError) as caught:
        toml_text.parse(text)
    assert "\n" not in str(caught.value)


def test_toml_of_people_is_parsed() -> None:
    text = 'a.b = "x.y.z"  # see a.b.c.d\nlist = [0.1, 0.2, 0.3]\n[t."q.r"]\nv = \'c:\\d\'\n# ....................\n'
    assert toml_text.parse(text + "# " + "a." * 100) == {
        "a": {"b": "x.y.z"},
        "list": [0.1, 0.2, 0.3],
        "t": {"q.r": {"v": "c:\\d"}},
    }
