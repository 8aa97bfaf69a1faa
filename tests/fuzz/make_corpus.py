"""Write the seed corpus of the fuzz targets: DIR/slcan, DIR/crsf and DIR/session, a file each.

    python3 tests/fuzz/make_corpus.py build/corpus

An input that once failed is kept in REGRESSIONS, in the hexadecimal that the driver prints.
"""

from __future__ import annotations

import sys
from pathlib import Path

SLCAN = {
    "commands": b"\x07\rC\rO\rS6\rV\rN\rL\rX\r",
    "frames": b"\x3ft7FC8B6000200192FA7CD\rt04088900100000000000\rt1230\rt12311A\r",
    "both_cases": b"\x01t7fc8b6000200192fa7cd\rt7FD8aAbBcCdDeEfF0011\r",
    "broken": b"\x1ft7FC8B6000200192FA7C\rt8008\rt12390011\rt12x8\rT000000008\r",
    "bells": b"\x02\aV\a\r\a\a\rt12\x00308\rV\r\xff\rV\r",
    "too_long": b"\x10" + 26 * b"V" + b"\r" + 27 * b"V" + b"\r" + 300 * b"t" + b"\rV\r",
}

STICKS = bytes.fromhex("c81816e0031ff8c0073ef0810f7ce0031ff8c0073ef0810f7c")
STATISTICS = bytes.fromhex("c80c142828640a0002032d6408")
"""Frames of a receiver, whose CRC is set by the target if the first byte is odd."""
S, L = STICKS + b"\0", STATISTICS + b"\0"
LOST = L[:5] + b"\0" + L[6:]
CRSF = {
    "frames": b"\1" + 3 * S + L + S,
    "lost": b"\1" + S + LOST + 4 * S + L + S,
    "ends": b"\1" + 3 * (S[:3] + 23 * b"\0") + 4 * (S[:3] + 22 * b"\xff" + b"\0") + 4 * (S[:3] + 23 * b"\0"),
    "cut": b"\1" + S[:20] + S + L[:9] + S,
    "inside": b"\0" + S[:9] + STATISTICS + b"\x51" + S,
    "wrong": b"\0" + S + L + S,
    "others": b"\1\xc8\x18\x17" + S[3:] + b"\xc8\x19\x16" + S + b"\xc8\xc8\xc8" + S,
}

UART, CAN = 0, 1
(
    TEXT,
    FRAME,
    RAW_FRAME,
    WAIT,
    LONG_WAIT,
    HELLO,
    VERB,
    ANSWER,
    REPLAY,
    SAMPLES,
    UPLOAD,
    SWITCH,
    WIRE,
    POWER,
    CUT,
    DISARM,
) = range(16)
"""op_t of fuzz_session.c."""
ARM, SAVE, BOOTLOADER, LOAD, DEFAULTS, LOCKSTEP, INJECTED, LIVE = 1, 2, 3, 4, 5, 16, 17, 18

OPENED = [TEXT, 4, *b"\rO\rV", TEXT, 1, 13, HELLO, UART, WAIT, 20]
LIVE_RUN = [VERB, UART, LIVE, 0, LONG_WAIT, 140]
ARMED = [*OPENED, *LIVE_RUN, ANSWER, 1, VERB, UART, ARM, 0]
CAN_ARMED = [HELLO, CAN, WAIT, 20, VERB, CAN, LIVE, 0, LONG_WAIT, 140, ANSWER, 2, VERB, CAN, ARM, 0]
SAVE_TWICE = [
    UPLOAD,
    UART,
    105,
    0,
    0x88,
    0x13,
    VERB,
    UART,
    SAVE,
    0,
    UPLOAD,
    UART,
    105,
    0,
    0xA0,
    0x0F,
    VERB,
    UART,
    SAVE,
    0,
]
BRIDGE = [UPLOAD, UART, 0, 0, 1, 0, VERB, UART, SAVE, 0, POWER, 1]

ABOUT = 5 * [SAMPLES, UART, 15, 3, WAIT, 8]
REST = [SAMPLES, UART, 10, 0, WAIT, 40]

SESSION = {
    "connect": [0, *OPENED, HELLO, CAN, HELLO, 2, HELLO, 3, LONG_WAIT, 60],
    "armed": [0, *ARMED, LONG_WAIT, 60],
    "armed_as_the_clock_wraps": [255, *ARMED, LONG_WAIT, 60],
    "gains_while_armed": [0, *ARMED, *(2 * [UPLOAD, UART, 37, 1, 0xFF, 0x02, LONG_WAIT, 4, UPLOAD, UART, 39, 0, 9, 0])],
    "gains_of_another_host": [0, *ARMED, HELLO, CAN, UPLOAD, CAN, 37, 1, 0xFF, 0x02, LONG_WAIT, 20],
    "let_go": [0, *ARMED, LONG_WAIT, 20, ANSWER, 0, LONG_WAIT, 20],
    "replayed": [0, *ARMED, WAIT, 40, ANSWER, 0, *(10 * [REPLAY, UART, WAIT, 20])],
    "replayed_again_and_again": [0, *ARMED, LONG_WAIT, 20, ANSWER, 8, LONG_WAIT, 20],
    "armed_over_can": [0, *CAN_ARMED, LONG_WAIT, 20, WIRE, 13, 1, LONG_WAIT, 30],
    "another_host": [0, *ARMED, HELLO, CAN, VERB, CAN, ARM, 0, VERB, CAN, SAVE, 0, REPLAY, CAN, DISARM, CAN],
    "another_run": [0, *ARMED, HELLO, CAN, VERB, CAN, LIVE, 0, LONG_WAIT, 5],
    "mismatch": [0, *ARMED, HELLO, 2, VERB, UART, LIVE, 0, LONG_WAIT, 5],
    "switch": [0, LONG_WAIT, 8, SWITCH, 1, LONG_WAIT, 200, SWITCH, 0, LONG_WAIT, 10],
    "switch_and_host": [0, LONG_WAIT, 8, SWITCH, 1, *OPENED, LONG_WAIT, 180, VERB, UART, ARM, 0, DISARM, UART],
    "injected": [0, *OPENED, VERB, UART, INJECTED, 0, *(60 * REST), ANSWER, 1, VERB, UART, ARM, 0, *(20 * REST)],
    "lockstep": [0, *OPENED, VERB, UART, LOCKSTEP, 0, FRAME, UART, 8, 0, 0, 0, 255, 0, 0, 0, *ABOUT],
    "saved": [0, *OPENED, *SAVE_TWICE, POWER, 0, *OPENED, VERB, UART, LOAD, 0, VERB, UART, DEFAULTS, 0],
    "power_cut": [0, *OPENED, *SAVE_TWICE[:10], CUT, 40, 2, *SAVE_TWICE[10:], POWER, 0, *OPENED],
    "worn_out": [0, *OPENED, WIRE, 16, 1, *SAVE_TWICE, POWER, 0, *OPENED],
    "bridge": [0, *OPENED, *BRIDGE, *ARMED, WIRE, 0, 1, LONG_WAIT, 5],
    "bootloader": [0, *OPENED, VERB, UART, BOOTLOADER, 0, LONG_WAIT, 40],
    "hang": [0, *ARMED, WIRE, 14, 1, LONG_WAIT, 20],
    "slow": [0, *ARMED, WIRE, 2, 1, WIRE, 3, 1, WIRE, 5, 1, LONG_WAIT, 20],
    "deaf_host": [0, *OPENED, WIRE, 3, 255, *(20 * [TEXT, 12, *b"V\rN\rV\rN\rV\rN\r"]), LONG_WAIT, 40],
    "frames_of_others": [0, *OPENED, RAW_FRAME, 8, 0, 8, *range(8), RAW_FRAME, 0, 1, 3, 1, 2, 3, LONG_WAIT, 30],
}

REGRESSIONS: dict[str, dict[str, str]] = {"slcan": {}, "crsf": {}, "session": {}}


def main() -> None:
    root = Path(sys.argv[1])
    seeds = {
        "slcan": dict(SLCAN),
        "crsf": dict(CRSF),
        "session": {name: bytes(program) for name, program in SESSION.items()},
    }
    for target, inputs in seeds.items():
        inputs.update({name: bytes.fromhex(text) for name, text in REGRESSIONS[target].items()})
        (root / target).mkdir(parents=True, exist_ok=True)
        for name, data in inputs.items():
            (root / target / name).write_bytes(data)


if __name__ == "__main__":
    main()
