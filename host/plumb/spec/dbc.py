"""The text of the DBC: the messages of the link (`link_messages.dbc`), and the frames and signals of every system.

plumb generates it from the declarations at run time, so that the systems on PLUMB_SYSTEM_PATH are in it, too.
`messages.dbc` is the form of it for other tools (`plumb.spec.tool_dbc`).
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from plumb.spec.declarations import systems
from plumb.spec.system import FRAMES_MAX, NUMBERS, WORDS_PER_FRAME, Frame, Part, System

LINK_PATH = Path(__file__).with_name("link_messages.dbc")
FIRST_BLOCK, BLOCK = 0x300, 0x40
"""Identifiers of system n begin at FIRST_BLOCK + n * BLOCK."""
FIRST_SLOT = 4
"""Low six bits of the identifier of a system's first frame. The board's frame counters are indexed by these bits;
systems share the counters because only one system runs at a time."""
SLOTS = range(FIRST_SLOT, FIRST_SLOT + FRAMES_MAX)
ANGLES = {"turn": "deg", "turn/s": "deg/s", "turn/s^2": "deg/s^2"}
"""Unit of a word -> its unit in the DBC: angles are shown in degrees."""


def frame_id(system: System, index: int) -> int:
    """CAN identifier of a system's frame by its place in the declaration."""
    return FIRST_BLOCK + BLOCK * system.number + FIRST_SLOT + index


def of_system(identifier: int) -> bool:
    """True for an identifier in the blocks of the systems."""
    return FIRST_BLOCK <= identifier < FIRST_BLOCK + BLOCK * len(NUMBERS)


def counter_slot(identifier: int) -> int:
    """Index of the counter that numbers the frames of an identifier: the identifier itself, but for a system's frame
    its place in the declaration, because the frames of all systems at one place share a counter."""
    return FIRST_SLOT + (identifier - FIRST_BLOCK - FIRST_SLOT) % BLOCK if of_system(identifier) else identifier


def frame_name(system: System, frame: Frame) -> str:
    """Name of a system's frame in the DBC: SYSTEM_FRAME."""
    return f"{system.name.upper()}_{frame.name}"


def frame_names(system: str) -> tuple[str, ...]:
    """DBC names of a system's frames, in the order of their identifiers."""
    declared = systems()[system]
    return tuple(frame_name(declared, frame) for frame in declared.frames)


def output_frames(system: str) -> dict[str, tuple[str, str]]:
    """Word that drives the actuator -> (frame, signal) that carries it; empty for a system without an actuator."""
    declared = systems()[system]
    parts = [(frame, part) for frame in declared.frames for part in (frame.half, frame.word) if part is not None]
    return {
        word.name: (frame_name(declared, frame), part.name)
        for word in declared.output_words
        for frame, part in parts
        if part.word == word
    }


def _number(value: float) -> str:
    return repr(int(value)) if value == int(value) else repr(value)


def _signal(part: Part, bits: int) -> str:
    word = part.word
    scale = 2.0 ** -int(word.format[1:]) if word.format.startswith("Q") else 1.0
    scale *= 2**part.shift * (360.0 if word.unit in ANGLES else 1.0)
    signed = word.type == "int32"
    low, high = (-(2.0 ** (bits - 1)), 2.0 ** (bits - 1)) if signed else (0.0, 2.0**bits - 1)
    return (
        f" SG_ {part.name} : {16 if bits == 16 else 32}|{bits}@1{'-' if signed else '+'} ({_number(scale)},0) "
        f'[{_number(low * scale)}|{_number(high * scale)}] "{ANGLES.get(word.unit, word.unit)}" HOST'
    )


def _frame(system: System, index: int) -> str:
    frame = system.frames[index]
    half = ' SG_ reserved : 16|16@1+ (1,0) [0|65535] "" HOST' if frame.half is None else _signal(frame.half, 16)
    return "\n".join(
        (
            f"BO_ {frame_id(system, index)} {frame_name(system, frame)}: 8 BOARD",
            ' SG_ crc8 : 0|8@1+ (1,0) [0|255] "" HOST',
            ' SG_ counter : 8|4@1+ (1,0) [0|15] "" HOST',
            ' SG_ step_low : 12|4@1+ (1,0) [0|15] "" HOST',
            half,
            _signal(frame.word, 32),
        )
    )


def _comments(system: System, index: int) -> Iterable[str]:
    frame, identifier = system.frames[index], frame_id(system, index)
    yield f'CM_ BO_ {identifier} "{system.name.capitalize()}: {frame.doc}";'
    for part in (frame.half, frame.word):
        if part is not None and part.word.name == "flags":
            bits = "; ".join(f"{bit} {flag.name}: {flag.doc}" for bit, flag in enumerate(system.flags))
            yield f'CM_ SG_ {identifier} {part.name} "Of the step. Bits: {bits}.";'


_SAMPLES, _RAWS, _COMMANDS = "CD", "CDEFGHIJ", "ABCDEF"
"""Letters of the frames that only systems with more inputs have."""
_FIRST_SAMPLE, _FIRST_COMMAND, _FIRST_RAW = 0x023, 0x028, 0x123


def counts_most() -> int:
    """The most raw counts that a step of any system has."""
    return max(system.counts for system in systems().values())


def inputs_most() -> int:
    """The most inputs that a step of any system has: raw counts and words of commands."""
    return max(system.inputs for system in systems().values())


def command_words_most() -> int:
    """The most words of commands that a step of any system has, in whole frames."""
    return max(system.inputs - system.counts for system in systems().values())


def sample_frames(counts: int) -> tuple[str, ...]:
    """Frames of a sample with so many counts, in the order of the counts."""
    return ("SAMPLE_A", "SAMPLE_B", *(f"SAMPLE_{letter}" for letter in _SAMPLES))[: -(-counts // WORDS_PER_FRAME)]


def raw_frames(inputs: int) -> tuple[str, ...]:
    """Frames with so many inputs of a step, in the order of the inputs."""
    return ("RAW_A", "RAW_B", *(f"RAW_{letter}" for letter in _RAWS))[: -(-inputs // WORDS_PER_FRAME)]


def command_frames(words: int) -> tuple[str, ...]:
    """Frames of a set of commands with so many words, in the order of the words."""
    return tuple(f"COMMAND_{letter}" for letter in _COMMANDS)[: -(-words // WORDS_PER_FRAME)]


def _three(identifier: int, name: str, board: bool, flags: str, words: Iterable[str]) -> str:
    """A message of three signed words; board: the sender. flags: `name bit|width`."""
    sender, receiver = ("BOARD", "HOST") if board else ("HOST", "BOARD")
    flag, place = flags.split()
    high = (1 << int(place.rpartition("|")[2])) - 1
    lines = [
        f"BO_ {identifier} {name}: 8 {sender}",
        f' SG_ crc8 : 0|8@1+ (1,0) [0|255] "" {receiver}',
        f' SG_ counter : 8|4@1+ (1,0) [0|15] "" {receiver}',
        f' SG_ {flag} : {place}@1+ (1,0) [0|{high}] "" {receiver}',
    ]
    lines += [
        f' SG_ {word} : {bit}|16@1- (1,0) [-32768|32767] "LSB" {receiver}'
        for word, bit in zip(words, (16, 32, 48), strict=True)
    ]
    return "\n".join(lines) + "\n\n"


def _more_inputs() -> tuple[str, str]:
    """Messages and comments of the frames that carry more inputs than the link's own frames."""
    messages, comments = "", ""
    for i, name in enumerate(sample_frames(counts_most())[2:]):
        at = 3 * (i + 2)
        words = [f"raw_{at + k}" for k in range(3)]
        messages += _three(_FIRST_SAMPLE + i, name, False, "step_high 12|2", words)
        comments += f'CM_ BO_ {_FIRST_SAMPLE + i} "As SAMPLE_B: channels {at} to {at + 2}, sent before SAMPLE_A.";\n'
    for i, name in enumerate(command_frames(command_words_most())):
        words = [f"command_{3 * i + k}" for k in range(3)]
        messages += _three(_FIRST_COMMAND + i, name, False, "run_tag 12|4", words)
        comments += (
            f'CM_ BO_ {_FIRST_COMMAND + i} "Words {3 * i} to {3 * i + 2} of a set of commands, sent before the '
            'SETPOINT that completes the set. Counter: the low four bits of its step number.";\n'
        )
    for i, name in enumerate(raw_frames(inputs_most())[2:]):
        at = 3 * (i + 2)
        words = [f"raw_{at + k}" for k in range(3)]
        messages += _three(_FIRST_RAW + i, name, True, "step_high 12|2", words)
        comments += (
            f'CM_ BO_ {_FIRST_RAW + i} "As RAW_A: inputs {at} to {at + 2} of this step, raw counts and then words of '
            'commands.";\n'
        )
    return messages, comments


def text() -> str:
    """The whole DBC: the messages of the link and the frames of all systems, those on PLUMB_SYSTEM_PATH included."""
    link = LINK_PATH.read_text(encoding="utf-8")
    comments, values = link.index("CM_ "), link.index("VAL_ ")
    everything = [(system, index) for system in systems().values() for index in range(len(system.frames))]
    frames = "".join(_frame(system, index) + "\n\n" for system, index in everything)
    described = "".join(line + "\n" for system, index in everything for line in _comments(system, index))
    signals = "".join(
        f' {number} "{system.name}.{name}"'
        for system in systems().values()
        for number, name in system.signals().items()
    )
    more, about = _more_inputs()
    return (
        link[:comments] + more + frames + link[comments:values].rstrip("\n") + "\n" + about + described + "\n"
        f"VAL_ 259 index{signals} ;\n" + link[values:]
    )
