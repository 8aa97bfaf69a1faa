"""Lockstep: the board runs one step for each sample from the host and returns the digest of the step.

Up to 16 samples are in flight. Lost frames are repeated in both directions: the board requests a missing sample by its
number, and answers a repeated sample with the digest of its step. A run completes or raises LinkError.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plumb.errors import LinkError
from plumb.link.identity import NackError, nack_error
from plumb.link.retries import IN_FLIGHT, REPLY_TIMEOUT_S, TRIES
from plumb.link.sample_codec import Said, WholeNumbers, sample_frames, samples_text, whole_inputs
from plumb.link.session import Session
from plumb.link.transports.slcan import SlcanParser, text_of_frames


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
        self._step_id = session.protocol["STEP"].identifier
        self._word_id = session.protocol["WORD"].identifier
        self._nack_id = session.protocol["NACK"].identifier
        self._text_parser = SlcanParser()
        self._pair = struct.Struct("<BBHI")
        session.begin("LOCKSTEP", frames, words)
        self._layout = session.input_layout()
        self._said = Said(0, self._layout.neutral)

    def run(self, raw: WholeNumbers, setpoint: WholeNumbers) -> npt.NDArray[np.uint32]:
        """Send n samples; returns their digests, shape (n,). raw: inputs, (n, 3 or more); setpoint: (n,) turn_q32.

        Raises LinkError if the board stops answering.
        """
        tag = self.session.run_tag
        inputs = whole_inputs(self._layout, raw)
        samples = samples_text(self.session.protocol, inputs, setpoint, self.step, self._said, tag, self._layout)
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
            self._said = Said(int(np.asarray(setpoint)[-1]), tuple(inputs[-1, self._layout.counts :].tolist()))
        return digests

    def exchange(self, raw: tuple[int, ...], setpoint: int = 0) -> StepReply:
        """Send one sample; returns the reply with all selected frames and words.

        Raises LinkError if the board stops answering or a selected word is lost; the run must then be repeated. The
        board does not repeat words, so the wait for one is as long as all repetitions of a sample.
        """
        session, step = self.session, self.step
        text = text_of_frames(
            sample_frames(session.protocol, step, raw, setpoint, self._said, session.run_tag, self._layout)
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
                commands = tuple(raw[self._layout.counts : self._layout.size]) or self._layout.neutral
                self._said = Said(setpoint, commands)
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
