"""Lockstep: the board runs one step for each sample from the host and returns the digest of the step.

Up to 16 samples are in flight. Lost frames are repeated in both directions: the board requests a missing sample by its
number, and answers a repeated sample with the digest of its step. A run completes or raises LinkError.
"""

from __future__ import annotations

import struct
from binascii import hexlify
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from plumb.errors import LinkError, UsageError
from plumb.link.identity import NackError, nack_error
from plumb.link.retries import IN_FLIGHT, REPLY_TIMEOUT_S, TRIES
from plumb.link.session import Session
from plumb.link.transports.slcan import SlcanParser, crc8_columns, text_of_frames
from plumb.spec.protocol import Frame, Protocol

_WITH_B, _WITH_SETPOINT = 0x40, 0x80
_LINE = 22


WholeNumbers = npt.NDArray[Any]  # Any: integers of any width, or floats without a fraction


def frame_lines(
    identifier: int | npt.NDArray[np.int64], second: npt.NDArray[np.uint8], body: npt.NDArray[np.uint8]
) -> npt.NDArray[np.uint8]:
    """SLCAN lines, shape (n, 22), of frames with their CRC.

    identifier: one for all frames, or (n,); second: byte 1, (n,); body: bytes 2 to 7, (n, 6).
    """
    count = len(second)
    entry = np.zeros((count, 10), np.uint8)
    entry[:, 0], entry[:, 1] = identifier >> 4, (identifier << 4 | 8) & 0xFF
    entry[:, 3], entry[:, 4:] = second, body
    entry[:, 2] = np.frombuffer(crc8_columns(entry.tobytes()), np.uint8)
    lines = np.full((count, _LINE), ord("\r"), np.uint8)
    lines[:, 0] = ord("t")
    lines[:, 1:21] = np.frombuffer(hexlify(entry.tobytes()).upper(), np.uint8).reshape(count, 20)
    return lines


@dataclass(frozen=True)
class SampleText:
    """Samples as SLCAN text. The lines of step i are text[ends[i]:ends[i + 1]]."""

    text: bytes
    ends: npt.NDArray[np.int64]

    def part(self, first: int, end: int) -> bytes:
        return self.text[self.ends[first] : self.ends[end]]


def samples_text(
    protocol: Protocol,
    raw: WholeNumbers,
    setpoint: WholeNumbers,
    step: int = 0,
    before: int = 0,
    run_tag: int = 0,
) -> SampleText:
    """SLCAN text of the samples from number `step` on. raw: int16 counts, (n, 3) or (n, 6); setpoint: (n,) turn_q32.

    Channels 3 to 5 are sent only if one of them is not zero, a setpoint only if it differs from the previous one
    (`before` for the first sample). run_tag: of the run, in every SETPOINT.
    """
    raw = np.asarray(raw)
    setpoint = np.asarray(setpoint, np.int64)
    if raw.ndim != 2 or raw.shape[1] not in (3, 6) or setpoint.shape != (len(raw),):
        raise UsageError(f"samples are (n, 3) or (n, 6) and setpoints (n,), not {raw.shape} and {setpoint.shape}")
    if raw.size and (raw.min() < -32768 or raw.max() > 32767):
        raise UsageError("a raw count is outside -32768 to 32767")
    counts = np.zeros((len(raw), 6), "<i2")
    counts[:, : raw.shape[1]] = raw
    numbers = step + np.arange(len(raw))
    second: npt.NDArray[np.uint8] = (numbers & 63).astype(np.uint8)
    has_b = counts[:, 3:].any(axis=1)
    has_setpoint = np.diff(setpoint, prepend=before) != 0
    body = np.zeros((len(raw), 6), np.uint8)
    body[:, :2] = (numbers & 0xFFFF).astype("<u2").view(np.uint8).reshape(-1, 2)
    body[:, 2:] = (setpoint & 0xFFFFFFFF).astype("<u4").view(np.uint8).reshape(-1, 4)
    flagged = second | (has_b * _WITH_B).astype(np.uint8) | (has_setpoint * _WITH_SETPOINT).astype(np.uint8)
    rows = np.stack(
        [
            frame_lines(protocol["SETPOINT"].identifier, (numbers & 15 | run_tag << 4).astype(np.uint8), body),
            frame_lines(protocol["SAMPLE_B"].identifier, second, np.ascontiguousarray(counts[:, 3:]).view(np.uint8)),
            frame_lines(protocol["SAMPLE_A"].identifier, flagged, np.ascontiguousarray(counts[:, :3]).view(np.uint8)),
        ],
        axis=1,
    )
    sent = np.stack([has_setpoint, has_b, np.ones(len(raw), bool)], axis=1)
    ends = np.concatenate([[0], np.cumsum(sent.sum(axis=1) * _LINE)])
    return SampleText(rows[sent].tobytes(), ends)


def sample_frames(
    protocol: Protocol, step: int, raw: Sequence[int], setpoint: int, before: int, run_tag: int = 0
) -> list[Frame]:
    """Frames of one sample of up to six counts, with the setpoint if it differs from `before`; as samples_text(), but
    without arrays."""
    counter, high = step & 15, step >> 4 & 3
    rest = tuple(raw[3:]) if any(raw[3:]) else ()
    frames = []
    if setpoint != before:
        frames.append(("SETPOINT", protocol["SETPOINT"].pack(counter, run_tag, step & 0xFFFF, setpoint)))
    if rest:
        frames.append(("SAMPLE_B", protocol["SAMPLE_B"].pack(counter, high, *rest)))
    flags = high | bool(rest) << 2 | (setpoint != before) << 3
    frames.append(("SAMPLE_A", protocol["SAMPLE_A"].pack(counter, flags, *raw[:3])))
    return [(protocol[name].identifier, data) for name, data in frames]


@dataclass(frozen=True)
class StepReply:
    """Reply to one sample: digest of the step, raw integers of the selected frames by signal name, and selected words
    by position in the record."""

    step: int
    digest: int
    values: dict[str, int]
    words: dict[int, int]
    saturated: bool


class Lockstep:
    """A run in lockstep, begun by the constructor. `run` sends many samples, `exchange` one."""

    def __init__(self, session: Session, frames: tuple[str, ...] = (), words: tuple[int, ...] = ()) -> None:
        self.session = session
        self.step = 0
        self._setpoint = 0
        self._step_id = session.protocol["STEP"].identifier
        self._word_id = session.protocol["WORD"].identifier
        self._nack_id = session.protocol["NACK"].identifier
        self._text_parser = SlcanParser()
        self._pair = struct.Struct("<BBHI")
        session.begin("LOCKSTEP", frames, words)

    def run(self, raw: WholeNumbers, setpoint: WholeNumbers) -> npt.NDArray[np.uint32]:
        """Send n samples; returns their digests, shape (n,). raw: (n, 3) or (n, 6) counts; setpoint: (n,) turn_q32.

        Raises LinkError if the board stops answering.
        """
        tag = self.session.run_tag
        samples = samples_text(self.session.protocol, raw, setpoint, self.step, self._setpoint, tag)
        count, base = len(samples.ends) - 1, self.step
        digests = np.zeros(count, np.uint32)
        done = sent = stalled = 0
        gap = IN_FLIGHT
        progress = self.session.listening.timeout(REPLY_TIMEOUT_S)
        while done < count:
            limit = min(count, done + IN_FLIGHT)
            if sent < limit:
                self._write(samples.part(sent, limit))
                sent = limit
            frames = self.session.receive(REPLY_TIMEOUT_S)
            before = done
            for identifier, data in frames:
                if identifier == self._step_id:
                    _, _, number, digest = self._pair.unpack(data)
                    ahead = (number - base - done) & 0xFFFF
                    if ahead == 0 and done < count:
                        digests[done] = digest
                        done, gap = done + 1, IN_FLIGHT
                    elif ahead < IN_FLIGHT:
                        # Go back once for each gap: until the repeated sample arrives, the samples that follow the gap
                        # are further and further ahead.
                        if ahead <= gap:
                            sent = done
                        gap = ahead
                elif identifier == self._nack_id:
                    sent = min(sent, max(done, done + self._expected(data, base + done)))
            if done > before:
                stalled = 0
                progress.renew()
            elif progress.over:
                stalled += 1
                progress.renew()
                gap, sent = IN_FLIGHT, done
                if stalled >= TRIES:
                    raise LinkError(f"the board stopped answering after step {base + done}: check cable and power")
        self.step += count
        if count:
            self._setpoint = int(np.asarray(setpoint)[-1])
        return digests

    def exchange(self, raw: tuple[int, ...], setpoint_turn_q32: int = 0) -> StepReply:
        """Send one sample; returns the reply with all selected frames and words.

        Raises LinkError if the board stops answering or a selected word is lost; the run must then be repeated. The
        board does not repeat words, so the wait for one is as long as all repetitions of a sample.
        """
        session, step = self.session, self.step
        text = text_of_frames(
            sample_frames(session.protocol, step, raw, setpoint_turn_q32, self._setpoint, session.run_tag)
        )
        pending, known = session.selection.count() + 1, session.protocol.by_identifier
        values: dict[str, int] = {}
        words: dict[int, int] = {}
        flags = digest = -1
        for _ in range(TRIES):
            self._write(text)
            reply, refused = session.listening.timeout(REPLY_TIMEOUT_S), False
            while pending and not refused and not reply.over:
                for identifier, data in session.receive(reply.left_s):
                    if identifier == self._step_id:
                        _, second, number, said = self._pair.unpack(data)
                        if number == step & 0xFFFF:
                            if digest < 0:
                                pending -= 1
                                reply.renew(TRIES * REPLY_TIMEOUT_S)
                            flags, digest = second >> 4, said
                    elif identifier == self._word_id:
                        _, second, index, value = self._pair.unpack(data)
                        if second >> 4 == step & 15:
                            place = index & 0xFF  # the system is in the high byte
                            pending -= place not in words
                            words[place] = value
                    elif identifier == self._nack_id:
                        self._expected(data, step)
                        refused = True
                    elif known[identifier].name in session.selection.frames:
                        values.update(known[identifier].decode(data))
                        pending -= 1
            if not pending:
                self.step += 1
                self._setpoint = setpoint_turn_q32
                return StepReply(step, digest, values, words, bool(flags & 4))
            if digest >= 0:
                raise LinkError(f"words of step {step} were lost on the link: run again")
        raise LinkError(f"the board stopped answering after step {step}: check cable and power")

    def _write(self, text: bytes) -> None:
        fast = self.session.fast
        if fast is not None:
            fast.write_text(text)
            return
        self.session.send(self._text_parser.feed(text))

    def _expected(self, data: bytes, step: int) -> int:
        """How far ahead of `step` the board is, from a NACK of a sample; raises LinkError for another reason."""
        said = self.session.protocol["NACK"].decode(data)
        error: NackError = nack_error(self.session.protocol, said)
        if error.reason not in ("SEQUENCE", "QUEUE_FULL"):
            raise error
        ahead = (said["detail"] - step) & 0xFFFF
        return ahead if ahead <= IN_FLIGHT else 0
