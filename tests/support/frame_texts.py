"""Frames of a run as the text of other tools, in the forms that python-can does not write."""

from __future__ import annotations

import base64
import gzip
import random
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial

from plumb.readers.log_file import Frames

Row = tuple[int, int, bytes]
"""Time in us since the first frame, identifier, data."""
START_S = 1764300000


def rows_of(frames: Frames) -> list[Row]:
    begin = int(frames["time_us"][0])
    return [
        (int(at) - begin, int(can_id), bytes(data)[:size])
        for at, can_id, size, _, data in frames.tolist()
    ]  # fmt: skip


def _joined(head: list[str], lines: list[str]) -> bytes:
    return ("\n".join([*head, *lines]) + "\n").encode()


def _hex(data: bytes) -> str:
    return data.hex(" ").upper()


def _gaps(rows: list[Row]) -> list[Row]:
    before = 0
    found = []
    for at, can_id, data in rows:
        found.append((at - before, can_id, data))
        before = at
    return found


ASC_HEAD = ["date Sat Sep 30 15:06:13.191 2017", "base {}  timestamps {}", "internal events logged",
            "Begin Triggerblock Sat Sep 30 15:06:13.191 2017", "   0.000000 Start of measurement"]  # fmt: skip


def asc(rows: list[Row], times: str = "absolute", base: str = "hex", comment: str = "// stand") -> bytes:
    head = [*(line.format(base, times) for line in ASC_HEAD), comment]
    rows = _gaps(rows) if times == "relative" else rows
    if base == "hex":
        lines = [
            f" {at * 1e-6:.6f} 1  {i:X}             Rx   d 8 {_hex(data)}  Length = 0 BitCount = 64"
            for at, i, data in rows
        ]
    else:
        lines = [f" {at * 1e-6:.6f} 1  {i}  Rx   d 8 {' '.join(str(byte) for byte in data)}" for at, i, data in rows]
    return _joined(head, lines).decode().encode("cp1252")


def asc_relative_with_events(rows: list[Row]) -> bytes:
    """Between the frames, events that are none, each with a part of the time."""
    lines = []
    for at, can_id, data in _gaps(rows):
        lines += [
            f" {(at - at // 3) * 1e-6:.6f} 1  Statistic: D 0 R 0",
            f" {at // 3 * 1e-6:.6f} 1  {can_id:X} Rx d 8 {_hex(data)}",
        ]
    return _joined([line.format("hex", "relative") for line in ASC_HEAD], lines)


def asc_canfd(rows: list[Row], flags: str = "200000", name: str = "") -> bytes:
    lines = [
        f" {at * 1e-6:.6f} CANFD   1 Rx  {i:x}  {name}  0 0 8  8 {_hex(data).lower()} 102203  133   {flags} e0006659"
        for at, i, data in rows
    ]
    return _joined([line.format("hex", "absolute") for line in ASC_HEAD], lines)


def candump_log(rows: list[Row]) -> bytes:
    return _joined([], [f"({START_S + at * 1e-6:.6f}) can0 {i:03X}#{data.hex().upper()}" for at, i, data in rows])


def _console(rows: list[Row], stamp: Callable[[int], str], flags: str = "", colour: bool = False) -> bytes:
    on, off = ("\x1b[1;33m", "\x1b[0m") if colour else ("", "")
    lines = [f"{stamp(at)}  {on}can0  {flags}{i:03X}{off}   [8]  {_hex(data)}   '........'" for at, i, data in rows]
    return _joined([], lines)


def _date(at: int) -> str:
    when = datetime.fromtimestamp(START_S, UTC)
    return f" ({when:%Y-%m-%d %H:%M}:{when.second + at // 10**6:02d}.{at % 10**6:06d})"


def _seconds(at: int) -> str:
    return f" ({at // 10**6:03d}.{at % 10**6:06d})"


def trc(rows: list[Row], version: str) -> bytes:
    head = [f";$FILEVERSION={version}", ";$STARTTIME=39878.6772258947;", ";   C:\\trace.trc", ";"]
    columns = {"2.0": "N,O,T,I,d,l,D", "2.1": "N,O,T,B,I,d,R,L,D", "3.0": "N,O,T,B,I,d,R,L,D"}
    if version == "1.0":
        head = [";##########", ";   Start time: 06.03.2009 16:15:12", ";---+--   ----+----"]
    elif version in columns:
        head.insert(1, f";$COLUMNS={columns[version]}")
    shape = {
        "1.0": "{n:6d})  {ms:.0f}  {i:04X}  8  {d}",
        "1.1": "{n:6d})  {ms:.1f}  Rx  {i:04X}  8  {d}",
        "1.2": "{n:6d})  {ms:.3f} 1  Rx  {i:04X}  8  {d}",
        "1.3": "{n:6d})  {ms:.3f} 1  Rx  {i:04X}  -  8    {d}",
        "2.0": "{n:6d}  {ms:.3f} DT  {i:04X} Rx 8  {d}",
        "2.1": "{n:6d}  {ms:.3f} DT 1  {i:04X} Rx -  8    {d}",
        "3.0": "{n:6d}  {ms:.3f} DT 1  {i:04X} Rx -  8    {d}",
    }[version]
    other = {
        "1.1": "  7)  0.0  Warng  FFFFFFFF  4  00 00 00 04  BUSLIGHT",
        "2.1": "  7  0.0 ST 1  - Rx -  4  00 00 00 00",
    }
    lines = [shape.format(n=n, ms=at * 1e-3, i=i, d=_hex(data)) for n, (at, i, data) in enumerate(rows, 1)]
    return _joined(head, [other[version], *lines] if version in other else lines)


def busmaster(rows: list[Row], mode: str = "SYSTEM", base: str = "HEX") -> bytes:
    head = ["***BUSMASTER Ver 2.4.0***", "***PROTOCOL CAN***", "***[START LOGGING SESSION]***", f"***{base}***",
            f"***{mode} MODE***", "***<Time><Tx/Rx><Channel><CAN ID><Type><DLC><DataBytes>***"]  # fmt: skip
    lines = []
    tenths = [(at // 100, i, data) for at, i, data in rows]
    for at, i, data in _gaps(tenths) if mode == "RELATIVE" else tenths:
        clock = f"{at // 36_000_000:02d}:{at // 600_000 % 60:02d}:{at // 10_000 % 60:02d}:{at % 10_000:04d}"
        said = f"0x{i:03X} s 8 {_hex(data)}" if base == "HEX" else f"{i} s 8 {' '.join(str(byte) for byte in data)}"
        lines.append(f"{clock} Rx 1 {said} ")
    return _joined(head, [*lines, "***[STOP LOGGING SESSION]***"])


def python_can(rows: list[Row]) -> bytes:
    head = ["timestamp,arbitration_id,extended,remote,error,dlc,data"]
    shape = "{:.6f},{},0,0,0,8,{}"
    return _joined(head, [shape.format(at * 1e-6, hex(i), base64.b64encode(d).decode()) for at, i, d in rows])


def gvret(rows: list[Row], *, direction: bool = True) -> bytes:
    way, said = (",Dir", ",Rx") if direction else ("", "")
    head = [f"Time Stamp,ID,Extended{way},Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8"]
    return _joined(head, [f"{at},{i:08X},false{said},0,8,{data.hex(',').upper()}," for at, i, data in rows])


FORMS: dict[str, tuple[Callable[[list[Row]], bytes], int]] = {
    "asc": (asc, 1),
    "asc, relative": (lambda rows: asc(rows, "relative"), 1),
    "asc, relative, with other events": (asc_relative_with_events, 1),
    "asc, decimal": (lambda rows: asc(rows, base="dec"), 1),
    "asc, cp1252": (lambda rows: asc(rows, comment="// Prüfstand 1"), 1),
    "asc, classic frames as CANFD": (asc_canfd, 1),
    "asc, the same with names": (lambda rows: asc_canfd(rows, name="Step_1"), 1),
    "candump -L": (candump_log, 1),
    "candump -ta": (lambda rows: _console(rows, lambda at: f" ({START_S + at * 1e-6:.6f})"), 1),
    "candump -tA": (lambda rows: _console(rows, _date), 1),
    "candump -td": (lambda rows: _console(_gaps(rows), _seconds), 1),
    "candump -tz": (lambda rows: _console(rows, _seconds), 1),
    "candump -x -c": (lambda rows: _console(rows, _seconds, "RX - -  ", colour=True), 1),
    "candump": (lambda rows: _console(rows, lambda at: ""), 0),
    "python-can csv": (python_can, 1),
    "gvret": (gvret, 1),
    "gvret, older": (lambda rows: gvret(rows, direction=False), 1),
    "busmaster": (busmaster, 100),
    "busmaster, relative": (lambda rows: busmaster(rows, "RELATIVE"), 100),
    "busmaster, decimal": (lambda rows: busmaster(rows, base="DEC"), 100),
    "trc 1.0": (lambda rows: trc(rows, "1.0"), 1000),
    "trc 1.1": (lambda rows: trc(rows, "1.1"), 100),
    **{f"trc {one}": (partial(trc, version=one), 1) for one in ("1.2", "1.3", "2.0", "2.1", "3.0")},
}
"""What each form makes of rows, and the resolution of its times in us; 0: it has none."""


def drawn_rows(rng: random.Random, count: int) -> list[Row]:
    """Frames of a bus at random moments from 0 on, some of them at once, their times rising."""
    at, found = 0, []
    for number in range(count):
        at += rng.choice([0, 0, rng.randrange(20_000), rng.randrange(300)]) if number else 0
        found.append((at, rng.randrange(0x800), rng.randbytes(8)))
    return found


def zipped(text: bytes) -> bytes:
    return gzip.compress(text, mtime=0)
