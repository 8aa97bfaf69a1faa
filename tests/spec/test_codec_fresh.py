"""What is generated is what the sources say: messages.[ch] from the DBC, params.[ch] from the table."""

from __future__ import annotations

import importlib.util
import re
import sys
import zlib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from plumb.spec import dbc, declarations, parameters
from plumb.spec.protocol import canonical_text, load_database, message_of, protocol, protocol_of
from support.campaigns import LONG

ROOT = Path(__file__).resolve().parents[2]
SAMPLED = {"1 byte replaced by a random one", "1 byte lost", "2 neighbouring bytes swapped"}
"""Kinds of damage that are measured anew."""
PARTLY = {"pins.md": ["pins", "strap"]}
"""Page that is written by hand -> its generated parts, each from its name in a comment to the comment "end"."""
DBC = ROOT / "host" / "plumb" / "spec" / "messages.dbc"


def tool(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_generated_files_are_fresh() -> None:
    for path, text in tool("generate").committed().items():
        assert path.read_text() == text, f"{path.relative_to(ROOT)} is stale: run tools/generate.py"
        if path.name in PARTLY:
            parts = re.findall(r"^<!-- (\w+) -->\n.+?\n<!-- end -->$", text, re.MULTILINE | re.DOTALL)
            assert parts == PARTLY[path.name], path.name
        else:
            assert path.suffix == ".dbc" or "GENERATED" in text.splitlines()[0], path.name


def test_hash_ignores_comments_and_covers_every_position(tmp_path: Path) -> None:
    text = dbc.text()
    known = protocol().dbc_hash

    def hash_of(changed: str) -> int:
        assert changed != text
        path = tmp_path / "messages.dbc"
        path.write_text(changed)
        return protocol_of(load_database(path)).dbc_hash

    assert hash_of(re.sub(r'CM_ BO_ 256 "[^"]*"', 'CM_ BO_ 256 "other words"', text)) == known
    assert hash_of(text.replace("SG_ digest", "SG_ checksum")) != known
    assert hash_of(text.replace("(0.5,0)", "(0.25,0)")) != known
    assert hash_of(text.replace('2 "INDEX"', '2 "PLACE"')) != known
    assert hash_of(text.replace('VERSION "3"', 'VERSION "4"')) != known


def test_hash_is_the_crc32_of_the_canonical_text() -> None:
    lines = canonical_text(load_database()).splitlines()
    assert lines[0] == "version 3"
    assert lines[1] == "message 8 KEEPALIVE 8 HOST"
    at = lines.index("message 256 STEP 8 BOARD")
    assert lines[at + 1 : at + 3] == [
        "signal crc8 0 8 little_endian unsigned 1.0 0.0 -",
        "signal counter 8 4 little_endian unsigned 1.0 0.0 -",
    ]
    assert protocol().dbc_hash == zlib.crc32(("\n".join(lines) + "\n").encode())
    header = (ROOT / "build/native/systems/generated/messages.h").read_text()
    assert f"#define MESSAGES_DBC_HASH 0x{protocol().dbc_hash:08X}U" in header


@pytest.mark.parametrize(
    ("before", "after", "complaint"),
    [
        ("BO_ 256 STEP: 8", "BO_ 256 STEP: 7", "does not fit"),
        ("SG_ step : 16|16@1+", "SG_ step : 16|12@1+", "one 16-bit and one 32-bit"),
        ("SG_ digest : 32|32@1+", "SG_ digest : 39|32@0+", "Intel"),
    ],
)
def test_a_definition_that_breaks_the_frame_rules_is_refused(
    tmp_path: Path, before: str, after: str, complaint: str
) -> None:
    path = tmp_path / "messages.dbc"
    path.write_text(dbc.text().replace(before, after, 1))
    import cantools

    with pytest.raises((ValueError, cantools.Error), match=complaint):
        for definition in load_database(path).messages:
            message_of(definition)


def test_every_message_is_described() -> None:
    for definition in load_database().messages:
        assert definition.comment, definition.name


def test_table_order_is_the_order_of_the_struct() -> None:
    rows = parameters.table()
    assert rows[0].name == "system" and [row.owner for row in rows] == sorted(row.owner for row in rows)
    assert parameters.crc32([row.default for row in rows]) == zlib.crc32(
        b"".join((row.default & 0xFFFFFFFF).to_bytes(4, "little") for row in rows)
    )


@pytest.mark.slow
def test_protocol_document_is_fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the damaged lines, which take half a minute, those of three kinds, unless PLUMB_LONG=1."""
    text = (ROOT / "docs/reference/protocol.md").read_text()
    generator = tool("gen_protocol")
    if not LONG:
        measure = sys.modules["measure_residuals"]
        shown = re.findall(r"(?m)^\| ([^|]+) \| [\d,]+ \| (\d+) \|", text)
        known = dict(shown)
        measured = measure.residuals

        def sampled(kind: str, trials: int, seed: int) -> int:
            return measured(kind, trials, seed) if kind in SAMPLED else int(known[kind])

        assert set(measure.KINDS) >= SAMPLED
        monkeypatch.setattr(measure, "residuals", sampled)
    assert generator.generate(text) == text, "docs/reference/protocol.md is stale: run tools/gen_protocol.py"
    assert text.count("<!-- begin") == 13


def test_protocol_document_does_not_depend_on_the_number_of_parameters() -> None:
    """So that two branches which add a parameter each do not both change the page."""
    text = (ROOT / "docs/reference/protocol.md").read_text()
    defaults = [row.default for row in parameters.table()]
    for value in (protocol().dbc_hash, parameters.crc32(defaults)):
        for shown in (str(value), f"{value:08x}", value.to_bytes(4, "little").hex()):
            assert shown.lower() not in text.lower()
    assert f"value {len(defaults)}\n" not in text and f"count {len(defaults)}," not in text


def test_signals_on_the_wire_are_the_words_of_each_record() -> None:
    names = {
        number: f"{system.name}.{name}"
        for system in declarations.systems().values()
        for number, name in system.signals().items()
    }
    assert protocol()["WORD"].choices["index"] == names
    for system in declarations.systems().values():
        last = system.number << 8 | system.record_bytes // 4 - 1
        assert names[system.number << 8] == f"{system.name}.raw_0" and names[last] == f"{system.name}.step"
        assert sum(number >> 8 == system.number for number in names) == system.record_bytes // 4


def test_factory_values_are_a_shipped_tuning() -> None:
    from plumb.contract.parameters import quantise
    from plumb.systems.quad.scenarios import DEFAULT_TUNING, TUNINGS

    rows = parameters.table()
    assert [row.default for row in rows if row.owner == "control"] == quantise(TUNINGS[DEFAULT_TUNING]).words()
    assert {row.name: row.default for row in rows}["period_us"] == TUNINGS[DEFAULT_TUNING].period_us


def test_other_tools_see_degrees_and_names() -> None:
    """What cantools monitor or SavvyCAN show with the DBC."""
    database: Any = load_database(DBC)
    angle = database.decode_message("QUAD_ANGLE", protocol()["QUAD_ANGLE"].pack(0, 0, 3001, -(1 << 29)))
    assert angle["tilt"] == pytest.approx(-45.0)
    assert angle["pulse_0"] == 1500.5
    bias = database.decode_message("QUAD_BIAS", protocol()["QUAD_BIAS"].pack(0, 0, 0, (1 << 28) // 360))
    assert bias["bias"] == pytest.approx(1.0, abs=1e-5)
    command = database.decode_message("QUAD_COMMAND", protocol()["QUAD_COMMAND"].pack(0, 0, 0, 1 << 21))
    assert command["command"] == 0.5
    status = database.decode_message("STATUS", protocol()["STATUS"].pack(0, 1, 2, 0, 0))
    assert (str(status["mode"]), status["armed"]) == ("REALTIME", 1)
    word = database.decode_message("WORD", protocol()["WORD"].pack(0, 0, 21, 0))
    assert str(word["index"]) == protocol()["WORD"].choice("index", 21)


def test_other_tools_see_every_flag_by_name() -> None:
    database: Any = load_database(DBC)
    status = database.decode_message("STATUS", protocol()["STATUS"].pack(0, 2, 2, 1 << 4 | 1 << 13, 1 << 8))
    assert {name for name, value in status.items() if name.startswith(("blocked_", "fault_")) and value} == {
        "blocked_link_closed", "blocked_other_link", "fault_internal_clock",
    }  # fmt: skip
    sensors = database.decode_message("SENSORS", protocol()["SENSORS"].pack(0, 0, 1 << 5 | 1 << 8, 3 << 8 | 6, 9))
    assert (sensors["rail_PB1"], sensors["stuck_PA0"], sensors["rail_PA0"]) == (1, 1, 0)
    states = (str(sensors["gyro_state"]), str(sensors["accelerometer_state"]), sensors["bus_failures"])
    assert states == ("UNCHANGED", "BUS_HANGS", 9)
    flags = declarations.systems()["turntable"].flags
    frame = protocol()["TURNTABLE_ATTITUDE_W"]
    for bit, flag in enumerate(flags):
        said = database.decode_message(frame.name, frame.pack(0, 0, 1 << bit, 1 << 30))
        assert [name for name, value in said.items() if name.startswith("flag_") and value] == [
            f"flag_{flag.name.lower()}"
        ]
        assert said["w"] == 1.0


def test_the_file_for_other_tools_has_the_frames_and_places_of_the_link() -> None:
    """The same messages; each signal lies within one word of the link, and together they cover its declared bits."""
    inner, outer = load_database(), load_database(DBC)
    assert [m.frame_id for m in inner.messages] == [m.frame_id for m in outer.messages]
    for definition in outer.messages:
        words = {s.name: (s.start, s.length) for s in inner.get_message_by_frame_id(definition.frame_id).signals}
        names = [signal.name for signal in definition.signals]
        assert len(set(names)) == len(names) and all(len(name) <= 32 for name in names)
        for signal in definition.signals:
            assert any(start <= signal.start and signal.start + signal.length <= start + length
                       for start, length in words.values()), signal.name  # fmt: skip
            assert signal.unit not in ("command", "1")
        assert definition.comment
    units = {signal.name: signal.unit for message in outer.messages for signal in message.signals}
    assert (units["lost"], units["starved"], units["tilt"]) == ("frames", "steps", "deg")
