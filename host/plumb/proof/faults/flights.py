"""Faults while a pilot's receiver holds the vehicle armed: no formality stops it, and what must stop it does."""

from __future__ import annotations

from plumb.physics.battery import BATTERY_PIN, Battery
from plumb.proof.faults.buses import sda_stuck
from plumb.proof.faults.clock import steps_stop
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.hangs import BY_WINDOW_WATCHDOG, loop_hangs
from plumb.proof.faults.host import closes_and_opens, disarms, ends_run, silent
from plumb.proof.faults.outputs import PROGRAM
from plumb.proof.faults.pilot import PILOT
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import RECEIVER, Scene
from plumb.proof.faults.sensors import GYRO_BACK, chip, digital
from plumb.spec import crsf

FLOWN = frozenset({PILOT})
CHIPS = frozenset({PILOT, "chips"})
GONE_S = 0.02
BY_COMMAND, BY_SWITCH, BY_STEP = (Told("EVENTS", "disarm_cause", 1 << bit) for bit in (6, 8, 15))
NO_SAMPLES, RECEIVER_LOST = (Told("PLAUSIBILITY", "disarmed_by", 1 << bit) for bit in (8, 11))


def disarms_with_a_nonce(scene: Scene) -> None:
    scene.session.disarm()


def asks_for_a_nonce(scene: Scene) -> None:
    session = scene.session
    run = session.protocol["RUN_BEGIN"].value("run", "REALTIME_LIVE")
    scene.notes["nonce"] = session.request("CHALLENGE", run, 0, answer="NONCE", first=run)["nonce"]


def begins_a_run(scene: Scene) -> None:
    session = scene.session
    run = session.protocol["RUN_BEGIN"].value("run", "REALTIME_LIVE")
    session.send([session.frame("RUN_BEGIN", run, scene.notes["nonce"])])


def locks(scene: Scene) -> None:
    """The arm switch on the board is closed."""
    scene.machine.drive("PC14", False)


def battery_is_low(scene: Scene) -> None:
    scene.machine.adc[BATTERY_PIN] = Battery(9.0).input_v()


def says(what: tuple[float, bool] | None) -> Action:
    def inject(scene: Scene) -> None:
        assert scene.pilot is not None
        scene.pilot.says = what

    return inject


def sends_also(frame: bytes) -> Action:
    """The receiver sends this behind each frame of channels."""

    def inject(scene: Scene) -> None:
        assert scene.pilot is not None
        scene.pilot.also = frame

    return inject


def switches_in_one_frame(scene: Scene) -> None:
    """Every eighth frame says off, the others on."""
    assert scene.pilot is not None
    scene.pilot.between = False


def sensor_is_gone(scene: Scene) -> None:
    """It does not acknowledge for a while."""
    chip("gyro", answers=False)(scene)
    scene.run(GONE_S)
    chip("gyro", answers=True)(scene)


def damaged(frame: bytes) -> bytes:
    """The same frame with another CRC."""
    return frame[:-1] + bytes([frame[-1] ^ 1])


MSP_WRITE = 0x7C
"""Type of a frame of CRSF that carries a message of another protocol."""
INSIDE = crsf.frame(MSP_WRITE, bytes([crsf.SYNC, 0xEA]) + crsf.sticks() * 2)
"""A frame with two frames of channels in its payload, the rotors off and the throttle low."""

FAULTS = (
    Fault("flown-host-silent", "flights", "the host that listens stops sending, while a pilot flies", silent, "held",
          needs=FLOWN, link=RECEIVER, holds=True),
    Fault("flown-link-closed-and-opened", "flights", "the host says C and O, while a pilot flies", closes_and_opens,
          "held", needs=FLOWN, link=RECEIVER, holds=True),
    Fault("flown-disarm", "flights", "DISARM without a nonce, while a pilot flies", disarms, "held", needs=FLOWN,
          link=RECEIVER, holds=True),
    Fault("flown-run-end", "flights", "RUN_END, while a pilot flies", ends_run, "held", needs=FLOWN, link=RECEIVER,
          holds=True),
    Fault("flown-run-begin", "flights", "RUN_BEGIN with its nonce, while a pilot flies", begins_a_run, "held",
          needs=FLOWN, link=RECEIVER, prepare=asks_for_a_nonce, holds=True),
    Fault("flown-locked", "flights", "the arm switch on the board closes, while a pilot flies", locks, "held",
          needs=FLOWN, link=RECEIVER, holds=True),
    Fault("flown-battery-low", "flights", "the battery has 9 V, below the declared lowest, while a pilot flies",
          battery_is_low, "held", (Told("PLAUSIBILITY", "missing", 1 << 8),), needs=FLOWN, link=RECEIVER, holds=True),
    Fault("flown-disarmed-with-nonce", "flights", "EXECUTE DISARM with its nonce, while a pilot flies",
          disarms_with_a_nonce, "command", (BY_COMMAND,), needs=FLOWN, link=RECEIVER),
    Fault("flown-switched-off", "flights", "the pilot switches the rotors off", says((0.3, False)), "pilot",
          (BY_SWITCH,), needs=FLOWN, link=RECEIVER, phases=True),
    Fault("flown-receiver-silent", "flights", "no frame of the receiver comes, on the stand", says(None), "receiver",
          (BY_STEP, RECEIVER_LOST), needs=FLOWN, link=RECEIVER, phases=True),
    Fault("flown-link-quality-0", "flights", "the receiver sends its last frames and a link quality of 0",
          sends_also(crsf.statistics(0)), "receiver", (BY_STEP, RECEIVER_LOST), needs=FLOWN, link=RECEIVER),
    Fault("flown-statistics-damaged", "flights", "link statistics of quality 0 with a wrong CRC, while a pilot flies",
          sends_also(damaged(crsf.statistics(0))), "held", needs=FLOWN, link=RECEIVER, holds=True),
    Fault("flown-channels-inside-a-frame", "flights", "frames of channels with the rotors off in the payload of another"
          " frame, while a pilot flies", sends_also(INSIDE), "held", needs=FLOWN, link=RECEIVER, holds=True),
    Fault("flown-switch-in-one-frame", "flights", "every eighth frame of the receiver switches the rotors off",
          switches_in_one_frame, "held", needs=FLOWN, link=RECEIVER, holds=True),
    Fault("flown-sda-stuck", "flights", "a chip holds SDA for nine clocks, while a pilot flies", sda_stuck, "sensor",
          (GYRO_BACK,), needs=CHIPS, link=RECEIVER, moves_on=True),
    Fault("flown-sensor-gone", "flights", "the sensor does not acknowledge for 20 ms, while a pilot flies",
          sensor_is_gone, "sensor", (GYRO_BACK,), needs=CHIPS, link=RECEIVER, moves_on=True),
    Fault("flown-sensor-lost", "flights", "the sensor does not acknowledge, while a pilot flies",
          chip("gyro", answers=False), "blind", (BY_STEP, NO_SAMPLES), needs=CHIPS, link=RECEIVER, phases=True),
    Fault("flown-sensor-frozen", "flights", "the data registers keep their values, while a pilot flies",
          chip("gyro", frozen=True), "frozen", (BY_STEP, NO_SAMPLES), needs=CHIPS, link=RECEIVER),
    Fault("flown-accel-frozen", "flights", "the accelerations in the registers keep their values, while a pilot flies",
          chip("gyro", forces_frozen=True), "sensor", (digital("its data do not change", 8),), needs=CHIPS,
          link=RECEIVER, moves_on=True),
    Fault("flown-steps-stop", "flights", "the timer that paces the steps stands still, while a pilot flies", steps_stop,
          "steps", (Told("EVENTS", "disarm_cause", 1 << 3),), needs=FLOWN, link=RECEIVER),
    Fault("flown-loop-hangs", "flights", "the main loop branches to itself, while a pilot flies", loop_hangs, "stall",
          (BY_WINDOW_WATCHDOG,), needs=FLOWN, link=RECEIVER, by=PROGRAM),
)  # fmt: skip
