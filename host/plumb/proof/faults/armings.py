"""Faults of hosts: their arming is over, they have another version, or their setpoints are not new."""

from __future__ import annotations

from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import HELD_BY_ITSELF, LISTEN_S, Scene
from plumb.spec.protocol import Frame, protocol

SILENCE = Told("EVENTS", "disarm_cause", 1 << 5)
TIMED_OUT = Told("SETPOINT_USED", "timed_out", 1)
BLOCKED = Told("NACK", "reason", choice="BLOCKED")
SEQUENCE = Told("NACK", "reason", choice="SEQUENCE")
SETPOINT, FOREIGN_SETPOINT = 1 << 24, 1 << 29
"""1.4 and 45 degrees, as binary angles."""
OLD_HOST_S = 0.35
LATE_ANSWER_S = 0.027
"""Just before the keep-alive times out with pulses at 50 Hz, and before a value that was issued 5 ms earlier
expires."""
REPEATED_EVERY_S = 0.02
STUCK_S = 0.3


# ---- armings ----


def armed_anew(scene: Scene) -> None:
    """The host disarms, and arms the board again."""
    scene.notes["arming"] = scene.session.holding.number
    scene.session.disarm()
    scene.session.arm()
    scene.run(0.1)


def old_host(scene: Scene) -> None:
    """The host that armed hangs; the host of the previous arming answers every value with the number that it knows."""
    scene.host_alive = False
    value = protocol()["KEEPALIVE_VALUE"]
    end_s = scene.now_s + OLD_HOST_S
    while scene.now_s < end_s:
        for identifier, data in scene.listen(LISTEN_S):
            if identifier == value.identifier:
                words = scene.notes["arming"], value.unpack(data)[3]
                scene.session.frames.write_frames([scene.session.frame("KEEPALIVE", *words)])


def armed_over_a_value(scene: Scene) -> None:
    """Arm again directly after a value of the previous arming that nobody answered."""
    scene.host_alive = False
    value = protocol()["KEEPALIVE_VALUE"]
    values: list[int] = []
    while not values:
        values = [
            value.unpack(data)[3] for identifier, data in scene.listen(LISTEN_S) if identifier == value.identifier
        ]
    scene.notes["value"] = values[-1]
    scene.host_alive = True
    scene.session.arm()


def value_of_the_arming_before(scene: Scene) -> None:
    """The host hangs; the value of the previous arming comes back with the number of this arming, before it is 40 ms
    old."""
    scene.host_alive = False
    scene.run(LATE_ANSWER_S)
    words = scene.session.holding.number, scene.notes["value"]
    scene.session.frames.write_frames([scene.session.frame("KEEPALIVE", *words)])


def disarmed(scene: Scene) -> None:
    scene.session.disarm()
    scene.run(0.15)


def armed_by_an_old_version(scene: Scene) -> None:
    """ARM as before version 3: a right nonce, without a number of the host."""
    arm = protocol()["EXECUTE"].value("verb", "ARM")
    nonce = scene.session.request("CHALLENGE", arm, 0, answer="NONCE", first=arm)["nonce"]
    scene.session.send([scene.session.frame("EXECUTE", arm, nonce)])
    scene.run(REPEATED_EVERY_S)


# ---- setpoints ----


def steered(seconds: float) -> Action:
    """The host sends a setpoint other than 0; all its frames are recorded."""

    def prepare(scene: Scene) -> None:
        scene.record()
        scene.session.set_setpoint(SETPOINT)
        scene.run(seconds)

    return prepare


def cease(scene: Scene) -> None:
    """The host's source of setpoints hangs; its keep-alives go on."""
    scene.session.setpoint.stop()


def repeat(count: int) -> Action:
    """The source hangs; another sender repeats its last setpoints again and again, byte for byte."""

    def inject(scene: Scene) -> None:
        recorded = scene.recorded("SETPOINT")[-count:]
        cease(scene)
        scene.send_again(recorded, OLD_HOST_S, REPEATED_EVERY_S)

    return inject


def setpoint_now(scene: Scene, setpoint: int, back: int = 0) -> Frame:
    """A setpoint with the number of the next step, or of `back` steps before it."""
    number = scene.session.setpoint.next_step - back & 0xFFFF
    return scene.session.frame("SETPOINT", number, setpoint, flags=scene.session.run_tag)


def setpoints_stuck(scene: Scene) -> None:
    """A buffer holds back setpoints that are new, and the source is silent for a while."""
    steered(0.1)(scene)
    cease(scene)
    for _ in range(4):
        scene.stuck.append(setpoint_now(scene, FOREIGN_SETPOINT))
        scene.run(REPEATED_EVERY_S)
    scene.run(STUCK_S)


def let_out(scene: Scene) -> None:
    for frame in scene.stuck:
        scene.session.frames.write_frames([frame])
        scene.run(LISTEN_S)


def overtaken(scene: Scene) -> None:
    """While the source is alive: setpoints with the number of its last one, and with earlier numbers."""
    scene.session.frames.write_frames([setpoint_now(scene, SETPOINT)])
    last = setpoint_now(scene, FOREIGN_SETPOINT)
    scene.session.frames.write_frames([last, *(setpoint_now(scene, FOREIGN_SETPOINT, back) for back in range(1, 4))])
    scene.run(LISTEN_S)


FAULTS = (
    *(
        Fault(f"old-host-at-a-new-arming{suffix}", "host",
              "the host hangs, the host of the arming before answers its values", old_host, "silence", (SILENCE,),
              link=link, prepare=armed_anew)
        for suffix, link in (("", "serial"), ("-on-can", "can"))
    ),
    Fault("value-of-the-arming-before", "host", "the host hangs, a value that was issued before arming comes back",
          value_of_the_arming_before, "silence", (SILENCE,), prepare=armed_over_a_value),
    Fault("arming-by-an-old-version", "host", "EXECUTE ARM of a host before version 3, over a link that is greeted",
          armed_by_an_old_version, "held", (BLOCKED,), prepare=disarmed, holds=True),
    Fault("setpoint-repeated", "host", "the source of setpoints hangs, its last SETPOINT is sent every 20 ms",
          repeat(1), "setpoint", (TIMED_OUT,), prepare=steered(0.3), moves_on=True),
    Fault("setpoint-repeated-on-can", "host", "the source of setpoints hangs, its last SETPOINT is sent every 20 ms",
          repeat(1), "setpoint", (TIMED_OUT,), link="can", prepare=steered(0.3), moves_on=True),
    Fault("setpoints-in-a-circle", "host", "the source of setpoints hangs, its last 16 are sent in a circle",
          repeat(16), "setpoint", (TIMED_OUT,), prepare=steered(0.9), moves_on=True),
    Fault("setpoint-too-old", "host", "setpoints that were new 300 ms ago are let out of a buffer", let_out, "held",
          (SEQUENCE,), frozenset({HELD_BY_ITSELF}), prepare=setpoints_stuck, holds=True),
    Fault("setpoint-overtaken", "host", "other setpoints with the number of the last one and of steps before it",
          overtaken, "held", (SEQUENCE,), prepare=steered(0.2), holds=True),
)  # fmt: skip
