"""Hostile files by structure, from a seed: valid containers with lengths, counts, links and nesting that lie,
compressed bombs, parts that are cut, repeated or swapped, and values of another type."""

from __future__ import annotations

import gzip
import json
import random
import struct
import zipfile
import zlib
from collections.abc import Callable
from io import BytesIO
from typing import Any

from plumb.files.block_file import sealed
from plumb.link.frame_records import PACK
from plumb.readers.log_file import MAGIC
from plumb.spec import dbc
from plumb.spec.protocol import protocol
from support.made_image import made_image

LENGTHS = (0, 1, 15, 16, 31, 47, 48, 49, 255, 65535, (1 << 31) - 1, 1 << 31, (1 << 32) - 1)
LIES = (0, 1, 24, 64, 1 << 20, 1 << 32, 1 << 40, (1 << 63) - 1, (1 << 64) - 1)
"""Lengths, counts and links of 64 bits."""
CONFUSED: tuple[Any, ...] = (None, True, -1, 1 << 70, 1.5, "text", "", [], [[]], {}, {"a": {}}, "\x00", "9" * 3000)
"""Values of another type than the one expected."""


def spoilt(rng: random.Random, data: bytes) -> bytes:
    """Now and then cut, doubled, with a part moved, or with a few bytes changed."""
    kind = rng.randrange(8)
    at, to = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:to] + data[at:]
    if kind == 2:
        return data[at:to] + data[:at] + data[to:]
    if kind == 3:
        changed = bytearray(data)
        for _ in range(rng.randrange(1, 6)):
            changed[rng.randrange(len(changed))] = rng.randrange(256)
        return bytes(changed)
    return data


def deep(rng: random.Random, begin: str, end: str) -> str:
    depth = rng.choice([10, 900, 5_000, 100_000])
    return begin * depth + end * rng.choice([0, depth])


# ---- frames ----


def frames(rng: random.Random, count: int) -> list[tuple[int, int, bytes]]:
    """Frames of the protocol with a right CRC and values that no board sends: time_us, identifier, data."""
    messages = list(protocol().messages.values())
    found = []
    for number in range(count):
        message = protocol()["STEP"] if rng.random() < 0.5 else rng.choice(messages)
        words = [rng.choice([0, 1, number, 32767, -1, rng.getrandbits(15)]) for _ in message.words]
        try:
            data = message.pack(rng.randrange(16), 0, *words)
        except (ValueError, struct.error, OverflowError):
            data = bytes(rng.randrange(256) for _ in range(8))
        found.append((rng.choice([number * 1000, 0, -(1 << 62), (1 << 62)]), message.identifier, data))
    return found


def blf(rng: random.Random) -> bytes:
    objects = b""
    for time_us, identifier, data in frames(rng, rng.choice([1, 5, 300])):
        size = rng.choice(LENGTHS) if rng.random() < 0.1 else 48
        version = rng.choice([0, 2, 3, 65535]) if rng.random() < 0.1 else 1
        kind = rng.choice([1, 86, 100, 101, 73, 10, 115, 65535]) if rng.random() < 0.2 else 86
        head = struct.pack("<4sHHLLLHHQ", b"LOBJ", rng.choice([16, 32, 32]), version, size, kind, 2, 0, 0, abs(time_us))
        objects += head + struct.pack("<HBBL8s", 1, 0, rng.choice([8, 8, 8, 255]), identifier, data)
    body = {
        0: lambda: zlib.compress(objects),
        1: lambda: zlib.compress(bytes(rng.choice([1, 64]) << 20), 9),
        2: lambda: zlib.compress(objects * 2000, 9),
        3: lambda: zlib.compress(objects)[:-5],
        4: lambda: objects,
    }[rng.choice([0, 0, 0, 1, 2, 3, 4])]()
    method = rng.choice([2, 2, 2, 0, 99])
    size = rng.choice(LENGTHS) if rng.random() < 0.2 else 32 + len(body)
    container = struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, size, 10, method, rng.choice([len(objects), *LENGTHS]))
    container += body + bytes(len(body) % 4)
    head = struct.pack("<4sLBBBBBBBBQQLL", b"LOGG", rng.choice([144, 144, 144, *LENGTHS]), 5, 0, 0, 0, 2, 6, 8, 1,
                       rng.choice(LIES), rng.choice(LIES), rng.choice(LENGTHS), 0)  # fmt: skip
    times = struct.pack("<16H", *(rng.choice([2024, 0, 65535]) if rng.random() < 0.1 else one
                                  for one in (2024, 1, 1, 1, 0, 0, 0, 0) * 2))  # fmt: skip
    whole = head + times + bytes(144 - len(head + times)) + container * rng.choice([1, 1, 3])
    return spoilt(rng, whole)


def _lines(rng: random.Random, head: list[str], line: Callable[[float, int, bytes], str]) -> bytes:
    number = ("nan", "inf", "-1", "1e308", "9" * 500, "", "0x10", "1_0")
    lines = list(head)
    for time_us, identifier, data in frames(rng, rng.choice([1, 30, 300])):
        text = line(time_us * 1e-6, identifier, data)
        if rng.random() < 0.1:
            words = text.split(" ")
            words[rng.randrange(len(words))] = rng.choice([*number, "[" * 1000, "FFFFFFFFFFFFFFFFF", "\0", "ä"])
            text = " ".join(words)
        lines.append(text * (rng.choice([1, 1, 5000]) if rng.random() < 0.05 else 1))
    if rng.random() < 0.1:
        lines.insert(rng.randrange(len(lines)), rng.choice(head or [""]))
    return spoilt(rng, (rng.choice(["\n", "\n", "\r\n", "\r"]).join(lines) + "\n").encode())


def asc(rng: random.Random) -> bytes:
    head = ["date Sat Sep 30 15:06:13.191 2017", "base hex  timestamps absolute", "internal events logged",
            "Begin Triggerblock Sat Sep 30 15:06:13.191 2017", "0.000000 Start of measurement"]  # fmt: skip
    if rng.random() < 0.3:
        head[rng.randrange(5)] = rng.choice(["date", "base dec", "base", "Begin", "date Xyz", "// " * 5000])
    shape = rng.choice([" {:.6f} 1  {:X}             Rx   d 8 {}", "{:.6f} CANFD   1 Rx  {:X}  1 0 d 64 {}"])
    return _lines(rng, head, lambda at, i, data: shape.format(at, i, data.hex(" ").upper()))


def candump(rng: random.Random) -> bytes:
    shape = rng.choice(["({:.6f}) can0 {:03X}#{}", "({:.6f}) can0 {:03X}##1{}", "({:.6f}) can0 {:08X}#R{}"])
    return _lines(rng, [], lambda at, i, data: shape.format(at, i, data.hex().upper()))


def trc(rng: random.Random) -> bytes:
    version = rng.choice(["1.1", "2.0", "2.1", "1.3", "9.9", "", "x"])
    head = [f";$FILEVERSION={version}", f";$STARTTIME={rng.choice(['43008.920986006946', 'nan', 'x', '1e300'])}",
            f";$COLUMNS={rng.choice(['N,O,T,B,I,d,R,L,D', 'N,O,T,I,d,l,D', 'N', '', 'N,' * 500])}", ";"]  # fmt: skip
    shape = rng.choice(["      1  {:.3f} DT 1 {:04X} Rx -  8    {}", "  1) {:.1f}  Rx  {:04X}  8  {}"])
    return _lines(rng, head, lambda at, i, data: shape.format(at * 1e3, i, data.hex(" ").upper()))


def console_text(rng: random.Random) -> bytes:
    """What candump prints, BusMaster's log or SavvyCAN's CSV, perhaps compressed."""
    shape, head = rng.choice(
        [
            ("({:.6f})  can0  {:03X}   [8]  {}", []),
            ("00:00:{:07.4f} Rx 1 0x{:X} s 8 {}", ["***BUSMASTER Ver 2.4.0***", "***RELATIVE MODE***"]),
            ("{},{:08X},false,0,8,{},", ["Time Stamp,ID,Extended,Bus,LEN,D1,D2"]),
        ]
    )
    text = _lines(rng, head, lambda at, i, data: shape.format(at, i, data.hex("," if "," in shape else " ")))
    return spoilt(rng, gzip.compress(rng.choice([text, bytes(1 << 25)]))) if rng.random() < 0.2 else text


def bus_csv(rng: random.Random) -> bytes:
    import base64

    head = ["timestamp,arbitration_id,extended,remote,error,dlc,data"]
    return _lines(rng, head, lambda at, i, data: f"{at},{hex(i)},0,0,0,8,{base64.b64encode(data).decode()}")


def mf4(rng: random.Random, good: bytes) -> bytes:
    """A good file with some of its blocks' lengths, links and counts changed, or a compressed block replaced."""
    data = bytearray(good)
    places = [at for at in range(64, len(data) - 24, 8) if data[at : at + 2] == b"##"]
    for _ in range(rng.choice([1, 1, 3])):
        at = rng.choice(places)
        field = at + rng.choice([8, 16, 24, 32, 40, 48, 72, 80, 88, 96])
        if field + 8 <= len(data):
            lie = rng.choice([*LIES, at, rng.choice(places), len(data), len(data) - 8])
            data[field : field + 8] = lie.to_bytes(8, "little")
    return spoilt(rng, bytes(data))


def plog(rng: random.Random, identity: dict[str, object], table: dict[str, int]) -> bytes:
    """Whole blocks, whose payloads lie."""

    def text(said: object) -> bytes:
        return json.dumps(said).encode()

    def head() -> bytes:
        said = dict(identity)
        said[rng.choice(list(said))] = rng.choice(CONFUSED)
        return rng.choice([text(said), text(identity), deep(rng, "[", "]").encode(), b'{"a":' * 1000, text(3)])

    def table_block() -> bytes:
        said: dict[str, object] = {"values": dict(table), "crc32": rng.choice([0, *CONFUSED])}
        if rng.random() < 0.6:
            said["values"] = rng.choice([*CONFUSED, {"system": rng.choice([-1, 99, 1 << 80, "x"])},
                                         {f"n{i}": i for i in range(rng.choice([10, 50_000]))},
                                         {**table, rng.choice(list(table)): rng.choice([1 << 80, -1, True, 1 << 31])},
                                         ])  # fmt: skip
        return text(said)

    def frames_block() -> bytes:
        records = b"".join(PACK(max(min(t, 1 << 62), -(1 << 62)), rng.choice([i, i, i, 1 << 31 | i]), 8, 0, data)
                           for t, i, data in frames(rng, rng.choice([1, 100, 2000])))  # fmt: skip
        return records[: rng.choice([len(records)] * 5 + [len(records) - 3])]

    def dbc_block() -> bytes:
        lines = dbc.text().splitlines()
        for _ in range(rng.choice([0, 1, 4])):
            at = rng.randrange(len(lines))
            lines[at] = rng.choice([lines[at] * 50, "", "BO_ 0 X: 99 A", 'SG_ a : 99999999999|64@1+ (0,0) [0|0] "" X',
                                    "(" * 5000, rng.choice(lines), lines[at].replace("8", "9" * 400)])  # fmt: skip
        return "\n".join(lines * rng.choice([1, 1, 1, 5])).encode()[: 1 << 20]

    makers = {"HEAD": head, "DBCT": dbc_block, "PARM": table_block, "FRMS": frames_block, "DONE": head}
    kinds = ["HEAD", "DBCT", "PARM", "FRMS", "FRMS", "DONE"]
    if rng.random() < 0.3:
        rng.shuffle(kinds)
    kinds += rng.choices([*makers, "ABCD"], k=rng.choice([0, 0, 5, 40]))
    good = {"HEAD": text(identity), "DBCT": dbc.text().encode(), "PARM": text({"values": table}), "DONE": b"{}"}
    blocks = b""
    for number, kind in enumerate(kinds):
        whole = good.get(kind) if rng.random() < 0.7 else None
        payload = whole if whole is not None else makers.get(kind, frames_block)()
        blocks += sealed(rng.choice([number, number, number, 0, (1 << 32) - 1]), kind, payload)
    return spoilt(rng, MAGIC.encode() + b"\n" + blocks)


# ---- arrays and tables ----


def npz(rng: random.Random) -> bytes:
    """Arrays, up to two of which have headers that lie: shapes, types, lengths, and members that are bombs."""
    arrays = (("gyr", 3), ("acc", 3), ("rate_hz", 0), ("ref_quat", 4), ("movement", 0))
    lying = rng.sample(arrays, rng.choice([0, 1, 1, 1, 2]))
    out = BytesIO()
    with zipfile.ZipFile(out, "w", rng.choice([zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED, zipfile.ZIP_LZMA])) as archive:
        for name, width in arrays:
            lies = (name, width) in lying
            rows = rng.choice([1000, 1000, 1000, 0, 1]) if lies else 1000
            shape: object = (rows, width) if width else ((rows,) if name == "movement" else ())
            described: object = "<f8"
            payload = struct.pack("<d", 100.0) if name == "rate_hz" else bytes(8 * max(rows * max(width, 1), 1))
            if lies and rng.random() < 0.3:
                shape = rng.choice(
                    [(1 << 40, 3), (-5, 3), (1 << 62, 1 << 62), (1000,) * 40, "x", (1.5, 3), (0, 1 << 62)]
                )
            if lies and rng.random() < 0.2:
                described = rng.choice(
                    ["|O", "<U9999999", "|V0", "x", [("a", "<f8", (1 << 30,))], "<c16", "|S0", "<M8[s]"]
                )
            text = repr(
                {"descr": described, "fortran_order": rng.choice([False, True, 3]) if lies else False, "shape": shape}
            )
            text = (
                text
                if not lies
                else rng.choice([text] * 6 + ["(" * 5000, "{}", "[" * 200 + "]" * 200, text * 500, "__import__('os')"])
            )
            length, version = len(text) + 1, rng.choice([1, 1, 1, 2, 3, 9]) if lies else 1
            if lies and rng.random() < 0.15:
                length = rng.choice([0, 65535, (1 << 32) - 1])
            size = struct.pack("<H", length & 65535) if version == 1 else struct.pack("<I", length)
            data = b"\x93NUMPY" + bytes([version, 0]) + size + text.encode() + b"\n" + payload
            if lies and rng.random() < 0.1:
                data += bytes(32 << 20)
            archive.writestr(f"{name}.npy", data)
        for number in range(rng.choice([0, 0, 0, 3000])):
            archive.writestr(f"more{number}", b"")
    return spoilt(rng, out.getvalue())


def recording_csv(rng: random.Random) -> bytes:
    head = "time_s,gyr_x_dps,gyr_y_dps,gyr_z_dps,acc_x_g,acc_y_g,acc_z_g"
    odd = ["nan", "inf", "1e308", "-1e-320", "9" * 400, "x", "", '"', '"' * 999, "\0", "١", "," * 20_000]
    rows = [f"{step * 0.01},1,2,3,0,0,1" for step in range(rng.choice([3, 250, 400]))]
    for _ in range(rng.choice([0, 1, 5])):
        fields = rows[at := rng.randrange(len(rows))].split(",")
        fields[rng.randrange(len(fields))] = rng.choice(odd)
        rows[at] = ",".join(fields)
    head = rng.choice([head] * 5 + [head + ",time_s" * 3000, head.replace("_g", "_mps2"), head + ',"', head * 50, ""])
    return spoilt(rng, "\n".join([head, *rows]).encode())


def ulog(rng: random.Random) -> bytes:
    """Messages whose lengths, formats and topics lie: fields of other types, counts and names, numbers of no topic,
    samples that are longer or shorter than their format."""
    combined = "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;"
    lies = (
        "float[3] gyro_rad;" * 3000,
        "double[256] more;" * 9,
        "float[99999999999] x;",
        "nested_t inner;",
        "float[0] x;",
        "char[9] timestamp;",
        "\u00e4[3] gyro_rad;",
        "",
        ";" * 60_000,
        "float[3] gyro_rad",
        "int8_t " + "a" * 60_000,
    )
    if rng.random() < 0.5:
        combined = rng.choice(
            [combined + rng.choice(lies), rng.choice(lies), combined.replace("3", rng.choice("0149"))]
        )
    if rng.random() < 0.1:
        combined += "".join(f"uint64_t[256] f{i};" for i in range(2500))

    def message(kind: str, body: bytes) -> bytes:
        size = rng.choice([0, 1, 65535, len(body) ^ 1]) if rng.random() < 0.02 else min(len(body), 65535)
        return struct.pack("<HB", size, ord(kind)) + body[:65535]

    head = b"ULog\x01\x12\x35" + bytes(9)
    head += message("F", f"sensor_combined:{combined}".encode()) * rng.choice([1, 1, 1, 0, 300])
    head += message("F", b"vehicle_attitude:uint64_t timestamp;" + rng.choice([b"float[4] q;", b"float q;", b"q", b""]))
    for number, topic in enumerate(
        ["sensor_combined", rng.choice(["vehicle_attitude", "sensor_combined", "", "x" * 9999])]
    ):
        head += message("A", struct.pack("<BH", rng.choice([0, 0, 0, 7]), number) + topic.encode())
    samples = b""
    for at in range(rng.choice([0, 3, 600, 600])):
        stamp = rng.choice([at * 4000] * 20 + [0, (1 << 64) - 1])
        values = [rng.choice([0.0, 1.0] * 8 + [float("nan"), float("inf"), 3e38]) for _ in range(6)]
        body = struct.pack("<HQ6f", rng.choice([0, 0, 0, 0, 0, 0, 0, 9]), stamp, *values)
        samples += message("D", body[: rng.choice([len(body)] * 30 + [0, 1, 2, 9])])
        samples += message("D", struct.pack("<HQ4f", 1, stamp, 1.0, 0.0, 0.0, values[0]))
        samples += message(rng.choice("LSXQ\xff"), bytes(9)) if rng.random() < 0.02 else b""
    return spoilt(rng, head + samples)


def table_set(rng: random.Random) -> dict[str, bytes]:
    """Files of a recorder of one table a sensor: other clocks, columns that lack, tables that are none, twice, or
    stand beside others."""
    count = rng.choice([250, 250, 2])
    names = ["Gyroscope.csv", "Accelerometer.csv", "Gravity.csv", "TotalAcceleration.csv", "Magnetometer.csv"]
    files = {}
    for name in rng.sample(names, rng.choice([1, 2, 3, 5, 5, 5])):
        first_s = rng.choice([0.0, 0.0, 0.0, 1e9, -5.0])
        rows = [f"{at},{first_s + 0.01 * at},1,2,3" for at in range(count)]
        for _ in range(rng.choice([0, 0, 1, 5])):
            rows[rng.randrange(len(rows))] = rng.choice(
                ["", "1,2", "nan,nan,nan,nan,nan", "x", "1e308,1e308,1,2,3", '"']
            )
        head = rng.choice(
            ["time,seconds_elapsed,z,y,x"] * 6 + ["time,z,y,x", "a,b", "", "x,y,z", "time,seconds_elapsed,z"]
        )
        files[name] = "\n".join([head, *rows]).encode()
    more = {
        "a.csv": recording_csv(rng),
        "meta.txt": b"\xff" * 99,
        "bomb.csv": bytes(8 << 20),
        "empty.csv": b"",
        "b.csv": gzip.compress(bytes(32 << 20)),
        "Gyroscope 2.csv": files.get("Gyroscope.csv", b"x"),
    }
    for name in rng.sample(sorted(more), rng.choice([0, 1, 1, 3])):
        files[name] = more[name]
    files |= {f"{number}.csv": b"1" for number in range(300)} if rng.random() < 0.05 else {}
    return files


def zip_of_tables(rng: random.Random) -> bytes:
    """A set of tables, perhaps in folders or under other names, in a zip that may be damaged."""
    out = BytesIO()
    kind = rng.choice([zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED, zipfile.ZIP_LZMA])
    before = rng.choice(["", "", "walk/", "../../", "meta/", "/", "xl/", "\u00e4" * 99 + "/"])
    with zipfile.ZipFile(out, "w", kind) as archive:
        for name, data in table_set(rng).items():
            archive.writestr(before + name, data)
    return spoilt(rng, out.getvalue())


def printed(rng: random.Random) -> bytes:
    """What a microcontroller prints, with labels without end, values that are none, and lines that never end a
    sample."""
    lines = []
    for _ in range(rng.choice([3, 300])):
        lines += rng.choice(
            [
                ["Accel X: 1.0, Y: 0, Z: 9.8 m/s^2", "Gyro X: 0, Y: 0.1, Z: 0 rad/s"],
                ["AcX = 1 | AcY = 2 | AcZ = 3 | GyX = 4 | GyY = 5 | GyZ = 6"],
                ["a/g: 1 2 3 4 5 6"],
            ]
        )
    odd = [
        "a" * 60_000,
        "a " * 30_000,
        "a:" * 30_000,
        "ax=" + "1" * 60_000,
        ".[" * 30_000,
        "Accel X: " * 7_000,
        "=",
        "12:00:00.1 -> " * 4_000,
        "a/g:" + " 1" * 30_000,
        "Accel X: 1e999, Y: 1e-999",
        "a" * 70_000,
        "ax:1" * 15_000,
    ]
    for _ in range(rng.choice([0, 1, 3, 30])):
        lines.insert(rng.randrange(len(lines)), rng.choice(odd))
    return spoilt(rng, "\n".join(lines).encode())


def toml(rng: random.Random, good: str) -> bytes:
    """A good file with values of another type, keys of many parts, and nesting."""
    lines = good.splitlines()
    assigned = [at for at, line in enumerate(lines) if "=" in line]
    values = ("1e400", "nan", "-inf", "9" * 5000, "true", "1979-05-27", "''", '"\\u0000"', "[]", "{}", "[[[]]]",
              "{a={b={c=1}}}", "0x" + "f" * 500, "07:32:00", "-1", "99999999999999999999")  # fmt: skip
    for _ in range(rng.choice([1, 1, 3])):
        at = rng.choice(assigned)
        lines[at] = f"{lines[at].partition('=')[0]}= {rng.choice(values)}"
    more = rng.choice(["", "", ".".join("a" * rng.choice([10, 30_000])) + " = 1",
                       "[" + "a." * rng.choice([50, 30_000]) + "a]", "x = " + deep(rng, "[", "]"),
                       "x = " + deep(rng, "{a=", "}"), "[[values]]", "values = 3", 'x = """', "[values.values]",
                       "\n".join(f"[t{i}.a.b]" for i in range(5000)), '"' + "\\u0041" * 5000 + '" = 1',
                       ".".join(['"a.b"'] * 20_000) + " = 1"])  # fmt: skip
    lines.insert(rng.choice([0, len(lines)]), more)
    return spoilt(rng, "\n".join(lines).encode())


# ---- images, vectors, lists ----


def good_image() -> bytes:
    return made_image(2000)


def good_elf() -> bytes:
    """An image as a program of two segments, with one section and no symbols."""
    image = good_image()
    head = b"\x7fELF\x01\x01\x01" + bytes(9)
    head += struct.pack("<HHIIIIIHHHHHH", 2, 40, 1, 0x08000000, 52, 116, 0, 52, 32, 2, 40, 1, 0)
    half = len(image) // 2
    for at, end in ((0, half), (half, len(image))):
        head += struct.pack("<8I", 1, 156 + at, 0x08000000 + at, 0x08000000 + at, end - at, end - at, 5, 4)
    return head + bytes(40) + image


def elf(rng: random.Random, good: bytes) -> bytes:
    """Program and section headers that lie: counts, overlapping parts of the whole file, addresses."""
    data = bytearray(good)
    for at, kind in ((28, "<I"), (32, "<I"), (42, "<H"), (44, "<H"), (46, "<H"), (48, "<H"), (50, "<H")):
        if rng.random() < 0.25:
            top = 65535 if kind == "<H" else (1 << 32) - 1
            struct.pack_into(kind, data, at, rng.choice([0, 1, 32, 40, 52, top, rng.randrange(top), len(data) & top]))
    table, size, count = struct.unpack_from("<I", data, 28)[0], *struct.unpack_from("<HH", data, 42)
    for index in range(min(count, 8)):
        for word in range(8):
            at = table + index * size + 4 * word
            if at + 4 <= len(data) and rng.random() < 0.1:
                struct.pack_into("<I", data, at, rng.choice([0, 1, len(data), 0x08000000, 0xFFFFFFFF, 0x20000000]))
    if rng.random() < 0.2:  # every header the whole file, at the beginning of the flash
        struct.pack_into("<I", data, 28, len(data))
        struct.pack_into("<HH", data, 42, 32, 65535)
        data += struct.pack("<8I", 1, 0, 0x08000000, 0x08000000, 60_000, 60_000, 5, 4) * 65535
    return spoilt(rng, bytes(data))


def linked_elf(rng: random.Random, good: bytes) -> bytes:
    """A linked image whose tables of sections and symbols lie: counts, sizes, and links to other tables or to all."""
    data = bytearray(good)
    at, count = struct.unpack_from("<I", data, 32)[0], struct.unpack_from("<H", data, 48)[0]
    lies = [0, 1, 16, 40, len(data) - 8, len(data), 0xFFFFFFFF, 0x80000000]
    for _ in range(rng.choice([1, 3, 20])):
        struct.pack_into("<I", data, at + 40 * rng.randrange(count) + 4 * rng.randrange(10), rng.choice(lies))
    if rng.random() < 0.3:  # every section a table of symbols that is the whole file
        header = struct.pack("<10I", 0, 2, 2, 0, 0, len(data), 0, 0, 4, 16)
        struct.pack_into("<I", data, 32, len(data))
        struct.pack_into("<H", data, 48, 65535)
        data += header * 65535
    return elf(rng, bytes(data)) if rng.random() < 0.3 else spoilt(rng, bytes(data))


def history(rng: random.Random, table: dict[str, int]) -> bytes:
    """Changes of parameters, a line each, whose fields are of another type."""
    lines = []
    for number in range(rng.choice([1, 5, 2000])):
        change: dict[str, Any] = {"time": "t", "did": "d", "before": dict(list(table.items())[:3]), "after": {},
                                  "crc32": number, "tuning": None}  # fmt: skip
        for _ in range(rng.choice([0, 1, 3])):
            change[rng.choice([*change, "more"])] = rng.choice(CONFUSED)
        lines.append(rng.choice([json.dumps(change)] * 8 + [deep(rng, "[", "]"), '{"a":' * 1000, "9" * 5000, ""]))
    return spoilt(rng, "\n".join(lines).encode("utf-8", "surrogatepass"))


def images(rng: random.Random) -> bytes:
    """The manifest of packaged images, with rows of another type."""
    row: dict[str, Any] = {"name": "all", "file": "all.bin", "sha256": "0" * 64, "bytes": 9, "git_hash": "0",
                           "git_dirty": False, "systems": ["a"], "golden": {"vectors": 1, "steps": 2}}  # fmt: skip
    said: dict[str, Any] = {"format": "plumb images 1", "images": [dict(row) for _ in range(rng.choice([1, 500]))]}
    for _ in range(rng.choice([1, 3])):
        one = rng.choice(said["images"])
        one[rng.choice(list(row))] = rng.choice([*CONFUSED, "../../etc/passwd", "/dev/zero", {"steps": "x"}])
    if rng.random() < 0.2:
        said[rng.choice(list(said))] = rng.choice(CONFUSED)
    return spoilt(rng, rng.choice([json.dumps(said), json.dumps(said), deep(rng, "[", "]")]).encode())


def ihex(rng: random.Random, good: bytes) -> bytes:
    """Records with a right checksum that lie about addresses, lengths and order."""
    lines = []
    for at in range(0, min(len(good), 4096), 16):
        piece = good[at : at + 16]
        lines.append((at & 0xFFFF, 0, piece))
        if rng.random() < 0.05:
            lines.append((0, rng.choice([1, 2, 3, 4, 5, 9]), rng.choice([b"", b"\x08\x00", b"\xff\xff", bytes(200)])))
    text = [":020000040800F2"] if rng.random() < 0.8 else []
    for address, kind, data in lines * rng.choice([1, 1, 20]):
        record = bytes([len(data)]) + address.to_bytes(2, "big") + bytes([kind]) + data
        text.append(":" + (record + bytes([-sum(record) & 0xFF])).hex().upper())
    return spoilt(rng, "\n".join([*text, ":00000001FF"]).encode())


def golden(rng: random.Random, good: bytes) -> bytes:
    """A header that lies, with a right check value."""
    end = good.index(b"\n")
    header = json.loads(good[:end])
    for _ in range(rng.choice([1, 1, 3])):
        target = rng.choice([header, header, *(one for one in (header.get("params"), header.get("final"))
                                               if isinstance(one, dict) and one)])  # fmt: skip
        if target:
            name = rng.choice(list(target))
            lies = (*CONFUSED, 1_000_000, (1 << 31) - 1, -(1 << 31), [0, 0], [5, 4], list(range(9)), [1.5])
            target[name] = rng.choice(lies)
            if rng.random() < 0.1:
                del target[name]
            if rng.random() < 0.1:
                target["more"] = 1
    text = json.dumps(header).encode()
    text = rng.choice([text] * 8 + [deep(rng, "[", "]").encode(), b'{"a":' * 3000, text * 2, b'{"format":NaN}'])
    whole = text + b"\n" + good[end + 1 : -4]
    return spoilt(rng, whole + zlib.crc32(whole).to_bytes(4, "little"))


def manifest(rng: random.Random, good: bytes) -> bytes:
    """Rows of another type, twice, or missing."""
    said = json.loads(good)
    rows = said["vectors"]
    for _ in range(rng.choice([1, 3])):
        row = rng.choice(rows)
        if isinstance(row, dict) and row:
            row[rng.choice(list(row))] = rng.choice(CONFUSED)
        if rng.random() < 0.3:
            rows.append(rng.choice([row, *CONFUSED]))
    said["vectors"] = rng.choice([rows, rows, rows, rng.choice(CONFUSED)])
    return spoilt(rng, rng.choice([json.dumps(said), json.dumps(said), deep(rng, "[", "]")]).encode())
