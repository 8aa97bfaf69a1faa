"""A shared library, checked with the golden vectors: reads a vector from stdin, prints digest and words of each step.

    plumb golden check --board "program:python library.py ./libmine.so"

The library has the functions of plumb's own (firmware/ports/batch/batch.c); change the calls to fit yours. The module
plumb.boards.program documents the lines. This file needs Python alone.
"""

import ctypes
import struct
import sys
import zlib

library = ctypes.CDLL(sys.argv[1])
vector = {"word": [], "param": []}
for line in sys.stdin:
    key, *rest = line.split()
    if key in ("word", "param"):
        vector[key].append(rest[1])
    else:
        vector[key] = rest[0]
    if key == "steps":
        break
kinds = {"int32": "i", "uint32": "I", "int64": "q", "uint64": "Q"}
record = struct.Struct("<" + "".join(kinds[kind] for kind in vector["word"]))
params = (ctypes.c_uint32 * len(vector["param"]))(*(int(value) & 0xFFFFFFFF for value in vector["param"]))
control = ctypes.create_string_buffer(library.plumb_sizeof_control())
words = ctypes.create_string_buffer(record.size)

library.plumb_control_init(control, params)
for step in range(int(vector["steps"])):
    *raw, setpoint = map(int, sys.stdin.readline().split())
    if len(raw) != 6:
        sys.exit(f"step {step} has {len(raw)} raw counts")
    library.plumb_control_step(control, params, (ctypes.c_int16 * 6)(*raw), ctypes.c_int32(setpoint))
    library.plumb_control_words(control, params, words)
    said = f"{zlib.crc32(words.raw):08x}"
    if vector["report"] == "words":
        said += "".join(f" {value}" for value in record.unpack(words.raw))
    print(said)
