"""Fill docs/reference/protocol.md: table of messages from the DBC, capacity of the links, errors that pass, examples.

The transcripts come from the real C session.

The tool writes the text between `<!-- begin NAME -->` and `<!-- end -->`; the rest is prose. What the number of
parameters or a record decides is shown as dots, so that a new parameter does not change the page.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "host"), str(ROOT / "tests"), str(ROOT / "tools")]

import wrap_prose  # type: ignore[import-not-found]  # noqa: E402
from measure_residuals import residual_table  # type: ignore[import-not-found]  # noqa: E402
from plumb.bench import bus_load  # noqa: E402
from plumb.link.board_frames import PERIODIC  # noqa: E402
from plumb.link.transports.slcan import frame_of_line, text_of_frames  # noqa: E402
from plumb.spec import parameters  # noqa: E402
from plumb.spec.protocol import Message, load_database, protocol  # noqa: E402
from support.link_functions import disarms  # noqa: E402
from support.margin import SLOW, constants, parts  # noqa: E402
from support.native_board import UartBoard  # noqa: E402


def message_table() -> str:
    """Every message: identifier, direction, the words of bytes 2 to 7, the flags of byte 1, and what it is for."""
    lines = ["| id | name | from | bytes 2.. | flags (bits 4..7 of byte 1) | |", "|---|---|---|---|---|---|"]
    database = load_database()
    for definition in sorted(database.messages, key=lambda message: message.frame_id):
        message = protocol()[definition.name]
        units = {signal.name: signal.unit for signal in definition.signals}
        comments = {signal.name: str(signal.comment or "") for signal in definition.signals}
        kinds = {"H": "u16", "h": "i16", "I": "u32", "i": "i32"}
        words = []
        for name, code in zip(message.words, message.layout.format[3:], strict=True):
            unit = f" [{units[name]}]" if units[name] else ""
            words.append(f"{kinds[code]} {'0' if name.startswith('reserved') else name}{unit}")
        flags = [
            f"{shift + 4}: {name}" if width == 1 else f"{shift + 4}-{shift + 3 + width}: {name}"
            for name, (shift, width) in message.flags.items()
        ]
        notes = [str(definition.comment)] + [f"{name}: {text}" for name, text in comments.items() if text]
        text = " ".join(notes).replace("|", "\\|")
        lines.append(
            f"| 0x{message.identifier:03X} | {message.name} | {message.sender.lower()} | {', '.join(words)} "
            f"| {', '.join(flags)} | {text} |"
        )
    return "\n".join(lines) + "\n"


def value_table() -> str:
    """Every named value, except the words of the record, which have their own list."""
    lines = ["| signal | values |", "|---|---|"]
    for message in sorted(protocol().messages.values(), key=lambda m: m.identifier):
        for signal, choices in message.choices.items():
            if message.name != "WORD":
                values = ", ".join(f"{number} {name}" for number, name in choices.items())
                lines.append(f"| {message.name}.{signal} | {values} |")
    return "\n".join(lines) + "\n"


def keepalive_table() -> str:
    """How often a running host loses the armed board, from tests/c/keepalive_study.c."""
    head = "| way there and back | frames lost | pulses | disarmed in 10 minutes, three times |"
    lines = [head, "|---|---|---|---|"]
    for round_trip_ms, loss, frame_us in (
        (2, 0.01, 20_000),
        (25, 0.0, 20_000),
        (25, 0.001, 20_000),
        (25, 0.01, 20_000),
        (25, 0.01, 10_000),
        (25, 0.01, 2500),
    ):
        counted = ", ".join(str(disarms(600, round_trip_ms, loss, frame_us, seed)) for seed in (1, 2, 3))
        lines.append(f"| {round_trip_ms} ms | {100 * loss:g} % | {1e6 / frame_us:.0f} Hz | {counted} |")
    return "\n".join(lines) + "\n"


def margin_table() -> str:
    """The worst parts from the host's last KEEPALIVE to neutral outputs, and their sum, for each oscillator."""
    longest_us = next(row.max for row in parameters.table() if row.name == "esc_period_us")
    sums = [parts(clock, longest_us) for clock in SLOW]
    lines = [f"| at most, in us | {' | '.join(SLOW)} |", "|---|---|---|"]
    lines += [f"| {row[0].name} | {' | '.join(f'{part.us:.0f}' for part in row)} |" for row in zip(*sums, strict=True)]
    totals = [f"{sum(part.us for part in whole):.0f}" for whole in sums]
    lines.append(f"| **sum**, less than {constants()['ARMING_SAFE_US']} | {' | '.join(totals)} |")
    return "\n".join(lines) + "\n"


def shown_value(message: Message, signal: str, value: int) -> str:
    """The value's name if it has one; hexadecimal for values that are not quantities."""
    if signal in ("asker", "value") and message.name in ("CHALLENGE", "KEEPALIVE", "KEEPALIVE_VALUE"):
        return f"{value:08x}"
    if signal == "request":
        return protocol().by_identifier[value].name
    if signal in ("dbc_hash", "digest", "nonce", "crc"):
        return f"{value & 0xFFFFFFFF:08x}"
    return message.choice(signal, value)


DECLARED_WORDS = {"dbc_hash", "digest", "index", "count", "crc"}
"""Words whose value follows from the declared parameters and records."""
DECLARED_ITEMS = {"DBC_HASH", "PARAMETER_COUNT", "PARAMETER_CRC", "RECORD_WORDS", "SYSTEMS", "UNSAFE_PARAMETER"}
DECLARED_DETAILS = {"PARAM_SET", "PARAM_COMMIT"}
"""Requests whose index or checksum the answer repeats as its detail."""


def declared_words(message: Message, words: dict[str, int]) -> set[str]:
    """The words of a frame that the transcript shows as dots."""
    named = DECLARED_WORDS & set(message.words)
    if message.name == "IDENTITY" and message.choice("item", words["item"]) in DECLARED_ITEMS:
        named.add("value")
    if message.name in ("ACK", "NACK") and protocol().by_identifier[words["request"]].name in DECLARED_DETAILS:
        named.add("detail")
    return named


def dotted(line: str, message: Message, hidden: set[str]) -> str:
    """The line `tIIIL...` without the bytes of the hidden words, and without the checksum over them (byte 0)."""
    if not hidden:
        return line
    sizes = (2, 4) if len(message.words) == 2 else (2, 2, 2)
    digits = {
        name: (2 * sum(sizes[:i]), 2 * size) for i, (name, size) in enumerate(zip(message.words, sizes, strict=True))
    }
    for start, length in ((5, 2), *((9 + at, length) for at, length in map(digits.__getitem__, hidden))):
        line = line[:start] + "." * length + line[start + length :]
    return line


ASKER = 0x5EED0001
"""What a host draws at random."""


class Scene:
    """A session with a new board, recorded as a transcript."""

    def __init__(self) -> None:
        self.board = UartBoard(seed=1)
        self.lines: list[str] = []
        self.received: dict[str, dict[str, int]] = {}
        self._counter: dict[int, int] = {}

    def _note(self, mark: str, line: bytes) -> None:
        text = line.decode("ascii") or "CR"
        frame = frame_of_line(line)
        if frame is not None:
            message = protocol().by_identifier[frame[0]]
            words = message.decode(frame[1])
            flags = [name for name, (_, width) in message.flags.items() if width == 1 and words[name]]
            hidden = declared_words(message, words)
            text = dotted(text, message, hidden)
            shown = [
                f"{name} {'..' if name in hidden else shown_value(message, name, words[name])}"
                for name in message.words
                if not name.startswith("reserved")
            ]
            text = f"{text:<24}{' '.join([message.name, *flags])}: {', '.join(shown)}".rstrip(": ")
        self.lines.append(f"{mark} {text}")

    def _decode(self, text: bytes) -> dict[str, dict[str, int]]:
        received = {}
        for line in re.findall(rb"[^\r\a]*[\r\a]", text):
            if line == b"\a":
                self.lines.append("< BEL")
                continue
            frame = frame_of_line(line[:-1])
            if frame is not None:
                name = protocol().by_identifier[frame[0]].name
                received[name] = protocol()[name].decode(frame[1])
                if name in PERIODIC:
                    continue
            self._note("<", line[:-1])
        return received

    def text(self, text: bytes, turns: int = 3) -> None:
        for line in text.split(b"\r")[:-1]:
            self._note(">", line)
            self._decode(self.board.say(line + b"\r", turns))

    def say(self, name: str, *words: int, flags: int = 0, counter: int | None = None, turns: int = 3) -> dict[str, int]:
        """Send one frame; returns the words of the last frame received."""
        message = protocol()[name]
        own = self._counter.get(message.identifier, 0)
        self._counter[message.identifier] = own + 1 & 15
        data = message.pack(own if counter is None else counter, flags, *words)
        line = text_of_frames([(message.identifier, data)])
        self._note(">", line[:-1])
        self.received = received = self._decode(self.board.say(line, turns))
        asked = [name for name in received if name not in PERIODIC]
        return received[asked[-1]] if asked else {}

    def remark(self, text: str) -> None:
        self.lines.append(f"  ({text})")

    def greet(self) -> None:
        """Open the link and send HELLO, without lines in the transcript."""
        hello = protocol()["HELLO"]
        data = hello.pack(0, 0, protocol().version, protocol().dbc_hash)
        self.board.say(b"O\r" + text_of_frames([(hello.identifier, data)]), 20)

    def rest(self, time_us: int) -> None:
        """Let time pass; frames of the board in it are left out of the transcript."""
        self.board.run_us(time_us)
        self.board.received()
        self.lines.append("< ...")

    def begin(self, run: str) -> None:
        number = protocol()["RUN_BEGIN"].value("run", run)
        nonce = self.say("CHALLENGE", number, 0)["nonce"]
        self.say("RUN_BEGIN", number, nonce)


def connect(scene: Scene) -> None:
    scene.text(b"\rC\rO\r")
    scene.say("HELLO", protocol().version, protocol().dbc_hash, turns=20)


def commands(scene: Scene) -> None:
    scene.text(b"V\rN\rS6\rX\r")
    scene.say("HELLO", protocol().version, protocol().dbc_hash)
    scene.remark("not open: refused")


def stage_and_commit(scene: Scene) -> None:
    scene.greet()
    rows = parameters.table()
    words = [row.default for row in rows]
    index = next(i for i, row in enumerate(rows) if row.name == "period_us")
    scene.say("PARAM_SET", index, 1)
    scene.remark("the index is that of period_us")
    scene.say("PARAM_SET", index, 1000)
    scene.say("PARAM_COMMIT", len(words), parameters.crc32(words))
    words[index] = 1000
    scene.say("PARAM_COMMIT", len(words), parameters.crc32(words))
    scene.say("PARAM_GET", index, 0)


def golden_run(scene: Scene) -> None:
    scene.greet()
    scene.say("SELECT", 0, 0b1100)
    scene.begin("LOCKSTEP")
    scene.say("SAMPLE_A", 1700, 2100, 3000, counter=0)
    scene.say("SETPOINT", 1, 1 << 28, counter=1)
    scene.say("SAMPLE_A", 1701, 2090, 3010, counter=1, flags=8)
    scene.remark("sample 2 is lost on the way")
    scene.say("SAMPLE_A", 1703, 2080, 3020, counter=3)
    scene.say("SAMPLE_A", 1702, 2085, 3015, counter=2)
    scene.say("SAMPLE_A", 1703, 2080, 3020, counter=3)
    scene.say("RUN_END", 0, 0)


def arm(scene: Scene) -> None:
    scene.greet()
    verb = protocol()["EXECUTE"].value("verb", "ARM")
    nonce = scene.say("CHALLENGE", verb, ASKER)["nonce"]
    scene.say("EXECUTE", verb, nonce ^ ASKER)
    scene.remark("blocked: no run, bit 1")
    scene.begin("REALTIME_LIVE")
    nonce = scene.say("CHALLENGE", verb, ASKER)["nonce"]
    scene.say("EXECUTE", verb, nonce ^ ASKER)
    scene.remark("blocked: not ready, bit 12; PLAUSIBILITY says what is missing. After 0.6 s at rest it is:")
    scene.rest(700_000)
    nonce = scene.say("CHALLENGE", verb, ASKER)["nonce"]
    scene.say("EXECUTE", verb, nonce ^ ASKER)
    arming, value = scene.received["ACK"]["detail"] & 0xFFFF, scene.received["KEEPALIVE_VALUE"]["value"]
    value = scene.say("KEEPALIVE", arming, value, turns=115)["value"]
    value = scene.say("KEEPALIVE", arming, value, turns=115)["value"]
    scene.remark("silence: 43 ms after the last keep-alive that counted the board is disarmed")
    scene.board.run_us(45_000)
    scene._decode(scene.board.received())
    scene.say("KEEPALIVE", arming, value, turns=115)
    scene.remark("too late, latched: only a new EXECUTE with a new nonce arms again")


SCENES: dict[str, Callable[[Scene], None]] = {
    "connect": connect,
    "commands": commands,
    "parameters": stage_and_commit,
    "golden": golden_run,
    "arm": arm,
}


def transcript(name: str) -> str:
    scene = Scene()
    SCENES[name](scene)
    return "```\n" + "\n".join(scene.lines) + "\n```\n"


def generate(text: str) -> str:
    """The document with all generated parts renewed."""
    parts = {"messages": message_table, "values": value_table}
    parts["keepalive"] = keepalive_table
    parts["margin"] = margin_table
    parts |= {"rates": bus_load.rate_table, "load": bus_load.step_table, "inputs": bus_load.inputs_table}
    parts["residuals"] = residual_table

    def part(match: re.Match[str]) -> str:
        name = match[1]
        body = parts[name]() if name in parts else transcript(name)
        return f"<!-- begin {name} -->\n{body}<!-- end -->"

    document: str = wrap_prose.wrapped(re.sub(r"<!-- begin (\w+) -->\n.*?<!-- end -->", part, text, flags=re.DOTALL))
    return document


def main() -> None:
    path = ROOT / "docs/reference/protocol.md"
    path.write_text(generate(path.read_text()))


if __name__ == "__main__":
    main()
