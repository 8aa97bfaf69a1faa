"""Receive a phone's datagrams from a UDP port or a file, and convert them to steps of a constant period.

A port that is open to the network can receive from any host: the first host with a valid datagram is used, datagrams of
others are counted and dropped.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from itertools import islice
from pathlib import Path

from plumb.errors import LinkError, UsageError, counted
from plumb.files import input_files
from plumb.judging.phone.inputs.apps import (
    LARGEST_BYTES,
    MOST_FILE_BYTES,
    MalformedError,
    Sample,
    Sensor,
    parse,
    read_file,
)
from plumb.judging.phone.inputs.resampler import SENSORS, Resampler, Step
from plumb.readers import recording

LOOPBACK, EVERYWHERE = "127.0.0.1", "0.0.0.0"
PLACES = {"loopback": LOOPBACK, "all": EVERYWHERE}
SENSOR_NAMES: dict[Sensor, str] = {"gyro": "gyroscope", "accel": "accelerometer"}
FEW = 20
"""Samples that may still arrive after the other sensor has stopped."""
BUFFER_BYTES = 1 << 20
"""Socket buffer for datagrams that arrive while the board is busy; the operating system may grant less."""
TOGETHER = 128
"""Most datagrams per call: about 0.6 s of a phone that sends 100 per second for each sensor."""
MOST_STEPS = 1 << 20
"""Most steps of a file: an hour and a half at 200 Hz. A sample a second after the one before makes hundreds."""
TURN_S = 0.1
"""Longest wait for a datagram."""


@dataclass
class Received:
    """Counts of datagrams. other: of a known app, without gyro or accelerometer. apps: app -> number of datagrams."""

    datagrams: int = 0
    malformed: int = 0
    other: int = 0
    strangers: int = 0
    apps: dict[str, int] = field(default_factory=dict)


class Saved:
    """A file of datagrams, one per line, written without buffering, so that it is complete however the run ends.

    Raises UsageError if it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise UsageError(f"cannot write {path}: {error.strerror}; choose another --save") from None

    def write(self, data: bytes) -> None:
        try:
            self._file.write(data.replace(b"\n", b" ").replace(b"\r", b" ") + b"\n")
        except OSError as error:
            raise UsageError(f"cannot write {self._path}: {error.strerror}; what came before is in it") from None

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Saved:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Intake:
    """Converts datagrams to steps. saved: file for the datagrams of the phone in use, including malformed ones."""

    def __init__(self, period_us: int, saved: Saved | None = None) -> None:
        self.received = Received()
        self.resampler = Resampler(period_us)
        self._saved = saved
        self._sender: str | None = None

    def push(self, data: bytes, sender: str = "") -> Iterator[Step]:
        """The steps that a datagram completes. Malformed datagrams and those of other senders count as dropped."""
        self.received.datagrams += 1
        if self._sender is not None and sender != self._sender:
            self.received.strangers += 1
            return
        if self._saved is not None:
            self._saved.write(data)
        try:
            datagram = parse(data)
        except MalformedError:
            self.received.malformed += 1
            return
        self._sender = sender
        self.received.apps[datagram.app] = self.received.apps.get(datagram.app, 0) + 1
        self.received.other += not datagram.samples
        for sample in datagram.samples:
            yield from self.resampler.feed(sample)

    def finish(self) -> Iterator[Step]:
        """The remaining steps, after the last datagram."""
        yield from self.resampler.finish()

    def to_json(self) -> dict[str, object]:
        return {**asdict(self.received), **asdict(self.resampler.counts)}

    def missing(self) -> str:
        """One sentence that explains why there is no step."""
        samples = self.resampler.counts.samples
        if not self.received.datagrams:
            return "nothing arrived"
        if not self.received.apps:
            return f"{counted(self.received.malformed, 'datagram')} arrived, none of a format that is known"
        if self.received.apps.keys() == {"SensorUDP"}:
            return "SensorUDP sends no gyroscope; take an app that does, as SensaGram or Sensorstream IMU+GPS"
        silent = [sensor for sensor, count in samples.items() if count < 2]
        what = " and no ".join(SENSOR_NAMES[sensor] for sensor in silent)
        apps = " and ".join(self.received.apps)
        return f"{apps} sent no {what}; switch it on in the app" if silent else f"{apps} sent too little"

    def silent_since(self, counted: dict[Sensor, int]) -> str:
        """One sentence that names the sensor that stopped. counted: samples of each when the last step was made."""
        samples = self.resampler.counts.samples
        silent = [SENSOR_NAMES[sensor] for sensor in SENSORS if samples[sensor] - counted[sensor] < FEW]
        return f"the phone's {silent[0]} stopped" if len(silent) == 1 else "the phone stopped sending"


def address_of(where: str) -> str:
    """The IPv4 address for --listen; raises UsageError."""
    if where in PLACES:
        return PLACES[where]
    try:
        return str(ipaddress.IPv4Address(where))
    except ValueError:
        raise UsageError(f"--listen '{where}': loopback, all, or an IPv4 address of this machine") from None


class Listener:
    """A UDP port. Use as a context manager."""

    def __init__(self, port: int, address: str = LOOPBACK) -> None:
        """port 0: any free port. Raises LinkError if the port is in use or the address is not of this machine."""
        if not 0 <= port <= 65535:
            raise UsageError(f"--udp {port}: a port is 0 (any) to 65535")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        try:
            self._socket.bind((address, port))
        except OSError as error:
            self.close()
            reason = error.strerror
            raise LinkError(f"cannot listen on {address}:{port}: {reason}; choose another --udp or --listen") from None
        self._socket.settimeout(TURN_S)
        self.address, self.port = self._socket.getsockname()

    def receive(self) -> tuple[bytes, str] | None:
        """The next datagram and its sender's address; None if none arrives within the time-out."""
        try:
            data, (host, _) = self._socket.recvfrom(LARGEST_BYTES + 1)
        except (TimeoutError, BlockingIOError):
            return None
        return data, host

    def receive_all(self, stop: list[int]) -> list[tuple[bytes, str]]:
        """The next datagram and those already received, at most TOGETHER; returns early if `stop` is not empty."""
        came: list[tuple[bytes, str]] = []
        try:
            while len(came) < TOGETHER and not stop:
                arrived = self.receive()
                if arrived is None:
                    break
                came.append(arrived)
                self._socket.settimeout(0.0)
        finally:
            self._socket.settimeout(TURN_S)
        return came

    def close(self) -> None:
        self._socket.close()

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def samples_of(recorded: recording.Recording) -> Iterator[Sample]:
    """A recording as the samples that a phone would send, in order."""
    for time_s, rate, force in zip(
        recorded.time_s.tolist(), recorded.gyr_dps.tolist(), recorded.acc_g.tolist(), strict=True
    ):
        yield Sample("gyro", time_s, tuple(rate))
        yield Sample("accel", time_s, tuple(force))


def is_recording(path: Path) -> bool:
    """Whether a file is of plumb's own formats of recordings; another one has datagrams."""
    return path.suffix.lower() == ".npz" or _is_table(path)


def steps_of_file(
    path: Path, period_us: int, decimate: int = 1, loaded: recording.Recording | None = None
) -> tuple[list[Step], Intake, recording.Recording | None]:
    """A recording of plumb's own formats, or a file of an app's datagrams, as steps; all runs of it. decimate: samples
    of a block of a recording, whose mean is taken first. loaded: the recording, where it is read already.

    Raises UsageError for a file that is neither, or that makes no step.
    """
    intake, recorded = Intake(period_us), None
    if loaded is not None or is_recording(path):
        recorded = recording.decimated(loaded or recording.load(path), decimate)
        made = (step for sample in samples_of(recorded) for step in intake.resampler.feed(sample))
    else:
        if decimate != 1:
            raise UsageError(f"--decimate is for recordings in .npz and .csv, and {path.name} is a file of datagrams")
        made = (step for data in read_file(path) for step in intake.push(data))
    steps = list(islice(made, MOST_STEPS))
    if next(made, None) is not None:
        raise UsageError(f"{path.name} makes more than {MOST_STEPS} steps of {period_us} us: cut it")
    steps += intake.finish()
    if not steps:
        raise UsageError(f"{path.name} makes no step: {intake.missing()}")
    return steps, intake, recorded


def _is_table(path: Path) -> bool:
    """True for a CSV file with plumb's header, which a datagram does not have."""
    input_files.check(path, MOST_FILE_BYTES, "give a recording, or a file of a phone's app")
    try:
        with path.open("rb") as file:
            return b"time_s" in file.readline(LARGEST_BYTES)
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from None
