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
vector = {"kind": "step", "word": [], "param": []}
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


def table(values):
    return (ctypes.c_uint32 * len(values))(*(int(value) & 0xFFFFFFFF for value in values))


def say(words):
    said = f"{zlib.crc32(words):08x}"
    if vector["report"] == "words":
        said += "".join(f" {value}" for value in record.unpack(words))
    print(said)


if vector["kind"] == "refusal":  # a table of parameters in each line: does the library take it?
    for line in sys.stdin:
        say(struct.pack("<I", library.plumb_params_valid(table(line.split()[1:])) != 0))
    sys.exit()

params = table(vector["param"])
control = ctypes.create_string_buffer(library.plumb_sizeof_control())
words = ctypes.create_string_buffer(library.plumb_sizeof_words(params[0]))
records = []
library.plumb_control_init(control, params)
for line in sys.stdin:
    if line.startswith("retune "):
        params, before = table(line.split()[1:]), params
        library.plumb_control_retune(control, before, params)
        continue
    step = len(records)
    *raw, setpoint = map(int, line.split())
    if len(raw) != 6:
        sys.exit(f"step {step} has {len(raw)} raw counts")
    library.plumb_control_step(control, params, (ctypes.c_int16 * 6)(*raw), ctypes.c_int32(setpoint))
    library.plumb_control_words(control, params, words)
    records.append(words.raw)
if vector["kind"] == "plausibility":  # what its checks know after each step
    states = ctypes.create_string_buffer(record.size * len(records))
    unit = ctypes.c_uint32(int(vector["variance_turn2_q56"]))
    library.plumb_plausibility_run(params, b"".join(records), len(records), unit, states)
    records = [states.raw[at : at + record.size] for at in range(0, len(states), record.size)]
for words in records:
    say(words)
