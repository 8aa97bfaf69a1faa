"""Read a log of `plumb record` without plumb: python read_log.py NAME.plog"""

import json
import struct
import sys
import zlib
from pathlib import Path

data, at, frames = Path(sys.argv[1]).read_bytes(), len("plumb log 1\n"), []
while at + 20 <= len(data):
    marker, size, number, kind = struct.unpack_from("<4sII4s", data, at)
    end = at + 16 + size
    if marker != b"\xf5PLB" or data[end : end + 4] != zlib.crc32(data[at:end]).to_bytes(4, "little"):
        break  # cut, or damaged: what came before is whole
    payload, at = data[at + 16 : end], end + 4
    if kind == b"HEAD":
        print(json.loads(payload)["command"])
    elif kind == b"PARM":
        print(len(json.loads(payload)["values"]), "parameters")
    elif kind == b"FRMS":
        frames += struct.iter_unpack("<qIBB8s", payload)
steps = [struct.unpack("<HI", content[2:]) for _, can_id, _, _, content in frames if can_id == 0x100]
print(f"{len(frames)} frames, {len(steps)} steps; the last digest is {steps[-1][1] if steps else 0:08x}")
