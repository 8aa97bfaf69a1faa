"""A board over a link: the host sends samples in lockstep and receives every step's digest."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from plumb import systems
from plumb.boards.contract import Answer, RawCounts, Setpoints, StepBoard, StepOutput, Stepper
from plumb.contract.scenario import System
from plumb.errors import UsageError
from plumb.link.endpoint_names import CanName, SerialName
from plumb.link.lockstep import Lockstep
from plumb.link.session import Session
from plumb.link.transports.open_bus import open_can
from plumb.spec.records import Words

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from plumb.contract.parameters import ControlParams

CHUNK_STEPS = 500
"""Steps between two updates of the progress bar."""


class LinkStepper:
    """A run over a link, one sample at a time; the outputs come in the system's OUTPUT_FRAMES."""

    def __init__(self, session: Session, system: System) -> None:
        self._signals = system.OUTPUT_FRAMES
        frames = dict.fromkeys(frame for frame, _ in self._signals.values())
        self._run = Lockstep(session, frames=tuple(frames))

    def step(self, raw: tuple[int, ...], setpoint: int) -> StepOutput:
        reply = self._run.exchange(raw, setpoint)
        outputs = {name: reply.values[signal] for name, (_, signal) in self._signals.items()}
        return StepOutput(reply.digest, outputs)

    def digests(self, raw: RawCounts) -> list[int]:
        """Keeps several samples in flight, so that the latency of an adapter does not delay every step."""
        import numpy as np

        return [int(digest) for digest in self._run.run(raw, np.zeros(len(raw), np.int32))]


class LinkParts:
    """A run over a link whose samples come in parts."""

    def __init__(self, session: Session) -> None:
        self._session, self._run = session, Lockstep(session)

    def run(self, raw: RawCounts, setpoint: Setpoints) -> npt.NDArray[np.uint32]:
        return self._run.run(raw, setpoint)

    def change(self, params: ControlParams) -> None:
        raise UsageError("a board over a link takes no other parameters in lockstep")

    def end(self) -> None:
        self._session.end()


class LinkBoard(StepBoard):
    """A board over an open session, which it owns and closes."""

    def __init__(self, name: str, session: Session) -> None:
        self.name = name
        self.session = session

    def _upload(self, params: ControlParams) -> None:
        self.session.upload(params.words(), **params.link_words(), period_us=round(params.period_s * 1e6))

    def run_injected(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints) -> Answer:
        import numpy as np
        from tqdm import tqdm

        self._upload(params)
        run = Lockstep(self.session)
        digests = []
        with tqdm(total=len(raw), desc=self.name, unit="step", leave=False, disable=None) as bar:
            for at in range(0, len(raw), CHUNK_STEPS):
                part = slice(at, at + CHUNK_STEPS)
                digests.append(run.run(raw[part], setpoint[part]))
                bar.update(len(digests[-1]))
        self.session.end()
        return Answer(np.concatenate(digests))

    def part_runner(self, params: ControlParams) -> LinkParts:
        self._upload(params)
        return LinkParts(self.session)

    def words_of_step(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, step: int) -> dict[str, int]:
        words = self.words_of_steps(params, raw, setpoint, step, step + 1)
        return {name: int(values[0]) for name, values in words.items()}

    def words_of_steps(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, first: int, end: int) -> Words:
        """Reset the controller, run the steps 0 to `end` - 1, and return every word of those from `first` on."""
        self._upload(params)
        run = Lockstep(self.session)
        run.run(raw[:first], setpoint[:first])
        self.session.select(words=range(self.session.record_words))
        record = b""
        for step in range(first, end):
            reply = run.exchange(tuple(int(count) for count in raw[step]), int(setpoint[step]))
            record += struct.pack(f"<{len(reply.words)}I", *(reply.words[index] for index in sorted(reply.words)))
        self.session.end()
        return Words.from_bytes(record, (end - first,), params.system)

    def stepper(self, params: ControlParams) -> Stepper:
        self._upload(params)
        return LinkStepper(self.session, systems.load(params.system))

    def close(self) -> None:
        self.session.close()


class SerialBoard(LinkBoard):
    """A board, or a served virtual board, at any address that pyserial opens."""

    def __init__(self, name: SerialName) -> None:
        super().__init__(f"serial:{name.port}", Session.open(name))


class CanBoard(LinkBoard):
    """A board, or a served virtual board, on any bus that python-can opens."""

    def __init__(self, name: CanName) -> None:
        super().__init__(name.text, Session.over(open_can(name)))
