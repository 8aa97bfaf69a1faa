"""Faults of the host that armed: it is silent, hangs, loses its cable, disarms or closes the link."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from plumb.errors import LinkError
from plumb.link.transports.slcan import text_of_frames
from plumb.proof.faults import core
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import Scene
from plumb.spec.protocol import Frame, protocol

SILENCE, COMMAND, CLOSED = 1 << 5, 1 << 6, 1 << 4
CAUSE = "EVENTS", "disarm_cause"
GONE_S = 0.1
"""How long the host is away."""
REPLAY_EVERY_S = 0.015
REPLAYED_S = 0.35
LATE_S = 0.044
"""Age of an answer that must no longer count; its value was issued some milliseconds earlier."""
LOOK_S = 0.002
BOTH_ARRIVE_S = 0.003
"""Two frames take 0.5 ms on either link; a pause of the loop for this time is not a stall."""
SETPOINT = 1 << 24
"""1.4 degrees, as a binary angle."""


def just_answered(scene: Scene) -> None:
    """Let time pass until the host has answered a value: that is its last frame that counts. Raises LinkError when it
    has not."""
    scene.record()
    if not scene.run_until(lambda: bool(scene.recorded("KEEPALIVE")), GONE_S):
        raise LinkError("the host has answered no value of the keep-alive")


def silent(scene: Scene) -> None:
    """The host stops sending, and listens."""
    scene.host_alive = False


def back(scene: Scene) -> None:
    """The host goes on sending as before."""
    scene.host_alive = True


def closes(scene: Scene) -> None:
    """`C` on the UART, CLOSE on CAN; a new connection learns the cause."""
    scene.host_alive = False
    if scene.link == "serial":
        scene.machine.uart.write(b"C\r")
    else:
        scene.session.send([scene.session.frame("CLOSE", 0, 0)])
    scene.run(GONE_S)
    scene.reconnect()


def cable_off(scene: Scene) -> None:
    """Neither side hears the other, until the cable is back and a new connection learns the cause."""
    scene.host_alive, scene.deaf = False, True
    scene.run(GONE_S)
    scene.reconnect()


def closes_and_opens(scene: Scene) -> None:
    """Both lines arrive before the main loop reads the first."""
    scene.machine.uart.write(b"C\rO\r")


def disarms_through(command: bytes) -> Action:
    """Another host than the one that armed opens or closes its UART with this command, and says DISARM there."""

    def inject(scene: Scene) -> None:
        scene.machine.uart.write(command + text_of_frames([scene.session.frame("DISARM", 0, 0)]))

    return inject


def in_one_turn(scene: Scene, first: Frame) -> None:
    """This frame and a HELLO of the right version both arrive before the main loop reads the first: the HELLO undoes
    its change before the next poll."""
    session = scene.session
    core.reach_the_loop(scene)
    session.send([first, session.frame("HELLO", session.protocol.version, session.protocol.dbc_hash)])
    core.pause_at(scene, scene.machine.cpu.pc, BOTH_ARRIVE_S)


def closes_and_greets(scene: Scene) -> None:
    """On CAN the HELLO opens the link."""
    in_one_turn(scene, scene.session.frame("CLOSE", 0, 0))


def other_version_and_back(scene: Scene) -> None:
    in_one_turn(scene, scene.session.frame("HELLO", 99, 0))


def disarms(scene: Scene) -> None:
    scene.session.send([scene.session.frame("DISARM", 0, 0)])


def ends_run(scene: Scene) -> None:
    scene.session.send([scene.session.frame("RUN_END", 0, 0)])


def other_version(scene: Scene) -> None:
    """A HELLO of another protocol version, over the link that armed."""
    scene.session.send([scene.session.frame("HELLO", 99, 0)])


def replay(count: int, *, backwards: bool = False) -> Action:
    """The host hangs; another sender repeats its last keep-alives again and again, byte for byte."""

    def inject(scene: Scene) -> None:
        recorded = scene.recorded("KEEPALIVE")[-count:]
        if backwards:
            recorded.reverse()
        scene.host_alive = False
        scene.send_again(recorded, REPLAYED_S, REPLAY_EVERY_S)

    return inject


def keep_back(scene: Scene, every: int) -> None:
    """From now on hold back every `every`-th answer of the host to a value, and note its time."""
    identifier, kept, count = protocol()["KEEPALIVE"].identifier, scene.kept_back, itertools.count()
    write = type(scene.session.frames).write_frames

    def write_others(frames: Sequence[Frame]) -> None:
        for frame in frames:
            if frame[0] == identifier and next(count) % every == 0:
                kept.append((scene.now_s, frame))
            else:
                write(scene.session.frames, [frame])

    vars(scene.session.frames)["write_frames"] = write_others


def answers_half(scene: Scene) -> None:
    """The host answers every second value of the board, at once."""
    keep_back(scene, 2)
    scene.run(0.3)


def answers_late(scene: Scene) -> None:
    """From now on every answer is late. The answers that were held back, and all others, come LATE_S after their value,
    each for the first time."""
    keep_back(scene, 1)
    end_s = scene.now_s + REPLAYED_S
    write = type(scene.session.frames).write_frames
    while scene.now_s < end_s:
        due = [frame for time_s, frame in scene.kept_back if LATE_S <= scene.now_s - time_s < LATE_S + LOOK_S]
        write(scene.session.frames, due)
        scene.run(LOOK_S)


def steered(scene: Scene) -> None:
    """The host sends a setpoint other than 0."""
    scene.session.set_setpoint(SETPOINT)
    scene.run(0.1)


def setpoints_cease(scene: Scene) -> None:
    """The host's source of setpoints hangs; its keep-alives go on."""
    scene.session.setpoint.stop()


def recorded(seconds: float) -> Action:
    """Let the run go on for this time, and record all frames of the host."""

    def prepare(scene: Scene) -> None:
        scene.record()
        scene.run(seconds)

    return prepare


FAULTS = (
    Fault("host-silent", "host", "the host stops sending", silent, "silence", (Told(*CAUSE, SILENCE),),
          prepare=just_answered, after=back, phases=True),
    Fault("host-silent-on-can", "host", "the host stops sending", silent, "silence", (Told(*CAUSE, SILENCE),),
          link="can", prepare=just_answered, after=back, phases=True),
    Fault("cable-off", "host", "the cable is off for 100 ms", cable_off, "closed", (Told(*CAUSE, SILENCE),)),
    Fault("link-closed", "host", "the host says C", closes, "closed", (Told(*CAUSE, CLOSED),)),
    Fault("link-closed-on-can", "host", "the host sends CLOSE", closes, "closed", (Told(*CAUSE, CLOSED),), link="can"),
    Fault("link-closed-and-opened", "host", "the host says C and O in one burst", closes_and_opens, "command",
          (Told(*CAUSE, CLOSED),)),
    Fault("link-closed-and-greeted-on-can", "host", "the host sends CLOSE and HELLO in one turn", closes_and_greets,
          "command", (Told(*CAUSE, CLOSED),), link="can"),
    Fault("host-disarms", "host", "DISARM", disarms, "command", (Told(*CAUSE, COMMAND),)),
    Fault("read-only-host-disarms", "host", "DISARM over a UART that is open read-only; a host on CAN armed",
          disarms_through(b"L\r"), "command", (Told(*CAUSE, COMMAND),), link="can"),
    Fault("closed-host-disarms", "host", "DISARM over a UART that is closed; a host on CAN armed",
          disarms_through(b"C\r"), "command", (Told(*CAUSE, COMMAND),), link="can"),
    Fault("host-ends-run", "host", "RUN_END", ends_run, "command", (Told(*CAUSE, COMMAND),)),
    Fault("host-of-another-version", "host", "HELLO of another protocol version over the link that armed",
          other_version, "command", (Told(*CAUSE, 1),)),
    Fault("host-of-another-version-and-back", "host",
          "HELLO of another protocol version, and one of this, over the link that armed in one turn",
          other_version_and_back, "command", (Told(*CAUSE, 1),), link="can"),
    Fault("setpoints-cease", "host", "no SETPOINT comes any more, keep-alives do: the setpoint becomes 0",
          setpoints_cease, "setpoint", (Told("SETPOINT_USED", "timed_out", 1),), prepare=steered, moves_on=True),
    Fault("keepalive-repeated", "host", "the host hangs, its last KEEPALIVE is sent every 15 ms", replay(1), "silence",
          (Told(*CAUSE, SILENCE),), prepare=recorded(0.3)),
    Fault("keepalive-repeated-on-can", "host", "the host hangs, its last KEEPALIVE is sent every 15 ms", replay(1),
          "silence", (Told(*CAUSE, SILENCE),), link="can", prepare=recorded(0.3)),
    Fault("keepalives-late", "host", "every KEEPALIVE comes 44 ms after its value, each for the first time",
          answers_late, "silence", (Told(*CAUSE, SILENCE),), prepare=answers_half),
    Fault("keepalives-of-16-replayed", "host", "the host hangs, its last 16 KEEPALIVE are sent in a circle", replay(16),
          "silence", (Told(*CAUSE, SILENCE),), prepare=recorded(0.3)),
    Fault("keepalives-of-256-replayed", "host", "the host hangs, its last 256 KEEPALIVE are sent in a circle",
          replay(256), "silence", (Told(*CAUSE, SILENCE),), prepare=recorded(4.0)),
    Fault("keepalives-backwards", "host", "the host hangs, its last 16 KEEPALIVE are sent in reverse",
          replay(16, backwards=True), "silence", (Told(*CAUSE, SILENCE),), prepare=recorded(0.3)),
)  # fmt: skip
