"""Frames that must have no effect: damaged, stale, replayed, or from a node that does not own the run; and foreign
frames that may have one."""

from __future__ import annotations

from collections.abc import Sequence

from plumb.errors import LinkError
from plumb.f103.attached.canwire import WireFrame
from plumb.link.transports.slcan import text_of_frames
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import LINKED, Heard, Scene, arm
from plumb.spec import parameters
from plumb.spec.protocol import Frame, protocol

COMMAND = 1 << 6
EVERY_S = 0.002
SETTLED_S = 0.3
ANSWERED_S = 0.35
OTHER_VERSION = 99
FOREIGN_SETPOINT = 1 << 29
"""An eighth of a turn."""
ASKER = 0x2545F491
"""The number that a host draws at random for CHALLENGE."""
FOREIGN_NONCES = (0, 1, 0xFFFFFFFF, 0x12345678, 0x80000000)
KP = "pid.kp_q22"
WILD_ESC = {"esc.mid_halfus": 4000, "esc.neutral_halfus": 4000, "esc.max_halfus": 16383}
REJECTED = Told("COUNTERS", "rejected")
ESC = frozenset({"esc"})


def refused(reason: str) -> Told:
    return Told("NACK", "reason", choice=reason)


class Stranger:
    """Another node on the CAN bus, while a host on the UART owns the run. The board's answers to it are recorded,
    too."""

    def __init__(self, scene: Scene, *, greeted: bool) -> None:
        self.scene, self.counters = scene, dict[int, int]()
        if greeted:
            self.send("HELLO", protocol().version, protocol().dbc_hash)
            scene.run(0.02)

    def send(self, name: str, *words: int, flags: int = 0) -> None:
        """Send a frame with a right counter and CRC, and wait for the answer."""
        message = protocol()[name]
        counter = self.counters.get(message.identifier, 0)
        self.counters[message.identifier] = counter + 1 & 15
        self.send_raw(WireFrame(message.identifier, message.pack(counter, flags, *words)))

    def send_raw(self, frame: WireFrame) -> None:
        wire = self.scene.machine.can.wire
        wire.send(frame)
        self.scene.run(EVERY_S)
        answers = {protocol()[name].identifier for name in ("ACK", "NACK", "NONCE")}
        now_s = self.scene.now_s
        for heard in wire.pop_frames():
            if heard.identifier in answers and not heard.extended:
                self.answered(Heard(now_s, heard.identifier, heard.data))

    def answered(self, heard: Heard) -> None:
        self.scene.heard.append(heard)
        self.last = protocol().by_identifier[heard.identifier].decode(heard.data)


def foreign_setpoints(*, greeted: bool) -> Action:
    def inject(scene: Scene) -> None:
        stranger = Stranger(scene, greeted=greeted)
        for _ in range(20):
            stranger.send("SETPOINT", scene.next_step, FOREIGN_SETPOINT & 0xFFFFFFFF, flags=scene.session.run_tag)

    return inject


def steered_from_can(scene: Scene) -> None:
    """The same host begins a run that takes its setpoints from CAN, and arms."""
    scene.session.begin("REALTIME_LIVE", frames=scene.live.FRAMES, elsewhere=("setpoints",))
    arm(scene)
    scene.run(SETTLED_S)


def setpoints_without_greeting(scene: Scene) -> None:
    """Only the version of the node is wrong: the failed greeting alone keeps its setpoints from counting."""
    stranger = Stranger(scene, greeted=False)
    stranger.send("HELLO", OTHER_VERSION, 0)
    scene.run(0.02)
    for _ in range(20):
        stranger.send("SETPOINT", scene.next_step, FOREIGN_SETPOINT & 0xFFFFFFFF, flags=scene.session.run_tag)


def foreign_keepalives(scene: Scene) -> None:
    """The owner's own keep-alives, sent by another node while the owner is silent."""
    scene.host_alive = False
    stranger = Stranger(scene, greeted=True)
    for frame in scene.recorded("KEEPALIVE")[-16:]:
        stranger.send_raw(WireFrame(*frame))
        scene.run(0.005)


def foreign_answers(scene: Scene) -> None:
    """The owner is silent; another node answers each value of the board at once, with the number of the arming."""
    number, value = scene.session.holding.number, protocol()["KEEPALIVE_VALUE"]
    scene.host_alive = False
    stranger = Stranger(scene, greeted=True)
    end_s, seen = scene.now_s + ANSWERED_S, 0
    while scene.now_s < end_s:
        new, seen = scene.heard[seen:], len(scene.heard)
        for heard in new:
            if heard.identifier == value.identifier:
                stranger.send("KEEPALIVE", number, value.unpack(heard.data)[3])
        scene.run(EVERY_S)


def foreign_arming(scene: Scene) -> None:
    """ARM with guessed nonces, and with one that the board gave to this node."""
    stranger = Stranger(scene, greeted=True)
    arm = protocol()["EXECUTE"].value("verb", "ARM")
    for nonce in FOREIGN_NONCES:
        stranger.send("EXECUTE", arm, nonce)
    stranger.send("CHALLENGE", arm, ASKER)
    stranger.send("EXECUTE", arm, stranger.last.get("nonce", 0) ^ ASKER)


def foreign_parameters(scene: Scene) -> None:
    """Another node stages the defaults and commits them."""
    stranger = Stranger(scene, greeted=True)
    words = [row.default for row in parameters.table()]
    for index, word in enumerate(words[:16]):
        stranger.send("PARAM_SET", index, word & 0xFFFFFFFF)
    stranger.send("PARAM_COMMIT", len(words), parameters.crc32(words))


def foreign_run(scene: Scene) -> None:
    """Another node begins its own run, as every greeted node may: that ends the present run."""
    stranger = Stranger(scene, greeted=True)
    run = protocol()["RUN_BEGIN"].value("run", "LOCKSTEP")
    stranger.send("CHALLENGE", run, 0)
    stranger.send("RUN_BEGIN", run, stranger.last["nonce"])


def foreign_disarm(scene: Scene) -> None:
    Stranger(scene, greeted=False).send("DISARM", 0, 0)


def odd_can_frames(scene: Scene) -> None:
    """The protocol's identifiers in extended, remote and short frames."""
    stranger = Stranger(scene, greeted=True)
    for name in ("KEEPALIVE", "SETPOINT", "DISARM", "RUN_END"):
        identifier = protocol()[name].identifier
        data = protocol()[name].pack(0, 0, 0, 0)
        for frame in (
            WireFrame(identifier, data, True),
            WireFrame(identifier << 18, data, True),
            WireFrame(identifier, data, False, True),
            *(WireFrame(identifier, data[:length]) for length in range(8)),
        ):
            stranger.send_raw(frame)


def say(scene: Scene, frames: Sequence[Frame]) -> None:
    """Send these frames unchanged on the owner's link."""
    scene.session.frames.write_frames(frames)
    scene.run(EVERY_S)


def flips(name: str, width: int) -> Action:
    """A valid frame of the owner, with every run of `width` neighbouring bits flipped once, identifier included."""

    def inject(scene: Scene) -> None:
        flags = scene.session.run_tag if name == "SETPOINT" else 0
        identifier, data = scene.session.frame(name, scene.next_step, FOREIGN_SETPOINT, flags=flags)
        whole = identifier << 64 | int.from_bytes(data, "big")
        for at in range(75 - width + 1):
            damaged = whole ^ ((1 << width) - 1) << at
            frame = damaged >> 64, (damaged & (1 << 64) - 1).to_bytes(8, "big")
            if scene.link == "serial":
                scene.machine.uart.write(text_of_frames([frame]))
            else:
                scene.machine.can.wire.send(WireFrame(*frame))
            if at % 8 == 7:
                scene.run(EVERY_S)

    return inject


def stale_tags(scene: Scene) -> None:
    """Setpoints with the tag of every other run, over the owner's link."""
    for tag in range(16):
        if tag != scene.session.run_tag:
            say(scene, [scene.session.frame("SETPOINT", scene.next_step, FOREIGN_SETPOINT, flags=tag)])


def samples_in_a_live_run(scene: Scene) -> None:
    """Injected samples while the board has sensors of its own."""
    for step in range(16):
        flags = step >> 4
        message = protocol()["SAMPLE_A"]
        say(scene, [(message.identifier, message.pack(step, flags, 4095, 0, 4095))])


def asked_and_refused(request: str, verb: str) -> Action:
    """Request a nonce, and send the command with it."""

    def inject(scene: Scene) -> None:
        number = protocol()[request].value("verb", verb)
        say(scene, [scene.session.frame("CHALLENGE", number, ASKER)])
        scene.run(0.01)
        nonces = [heard for heard in scene.heard if heard.identifier == protocol()["NONCE"].identifier]
        if not nonces:
            raise LinkError("the board gives no nonce")
        nonce = protocol()["NONCE"].decode(nonces[-1].data)["nonce"]
        say(scene, [scene.session.frame(request, number, nonce ^ ASKER)])

    return inject


def armed_once_more(scene: Scene) -> None:
    """The host disarms, arms and disarms again; everything it sends is recorded."""
    scene.session.disarm()
    scene.record()
    scene.session.arm()
    scene.run(0.1)
    scene.session.disarm()
    scene.run(0.15)


def arming_replayed(scene: Scene) -> None:
    """Replay the frames that armed the board a moment ago, byte for byte; before that, the command alone, while its
    nonce is still the last one that the board issued, but used."""
    say(scene, scene.recorded("EXECUTE"))
    for frame in list(scene.sent):
        if frame[0] != protocol()["DISARM"].identifier:
            say(scene, [frame])


def disarmed(scene: Scene) -> None:
    scene.session.disarm()
    scene.run(0.15)


def run_ended(scene: Scene) -> None:
    scene.session.end()
    scene.run(0.15)


def stiffened(scene: Scene) -> None:
    """The owner raises a gain after arming, which is allowed."""
    words = scene.session.read_parameters()
    kp = [row.name for row in parameters.table()].index(KP)
    words[kp] = round(words[kp] * 1.5)
    commit = scene.session.frame("PARAM_COMMIT", len(words), parameters.crc32(words))
    say(scene, [scene.session.frame("PARAM_SET", kp, words[kp] & 0xFFFFFFFF), commit])
    scene.run(0.1)
    scene.listen_anew()


def wild_gains(scene: Scene) -> None:
    """Commits of the owner that an armed board must refuse: extreme gains, gains of another sign, gains of 0, words
    other than gains, each with its right CRC; and six in a row, each less than twice the one before."""
    before = scene.session.read_parameters()
    frame = scene.session.frame
    kp = [row.name for row in parameters.table()].index(KP)
    for times in range(6):
        words = [*before[:kp], round(before[kp] * 1.6 ** (times + 1)), *before[kp + 1 :]]
        commit = frame("PARAM_COMMIT", len(words), parameters.crc32(words))
        say(scene, [frame("PARAM_SET", kp, words[kp] & 0xFFFFFFFF), commit])
    for number, row in enumerate(parameters.table()):
        others = (
            {row.max, row.min, 0, -before[number], 3 * before[number], before[number] // 4} if row.live else {row.min}
        )
        for value in others - {before[number]}:
            if row.min <= value <= row.max:
                words = [*before[:number], value, *before[number + 1 :]]
                staged = frame("PARAM_SET", number, value & 0xFFFFFFFF)
                commit = frame("PARAM_COMMIT", len(words), parameters.crc32(words))
                say(scene, [staged, commit, frame("PARAM_SET", number, before[number] & 0xFFFFFFFF)])


def wild_pulses(scene: Scene) -> None:
    """Parameters that would give a disarmed speed controller full throttle, and a live run that nobody arms."""
    names = [row.name for row in parameters.table()]
    for name, value in WILD_ESC.items():
        say(scene, [scene.session.frame("PARAM_SET", names.index(name), value)])
    words = [WILD_ESC.get(row.name, row.default) for row in parameters.table()]
    say(scene, [scene.session.frame("PARAM_COMMIT", len(words), parameters.crc32(words))])
    scene.session.begin("REALTIME_LIVE")


def recorded(scene: Scene) -> None:
    scene.record()
    scene.run(0.3)


_SILENCE = Told("EVENTS", "disarm_cause", 1 << 5)

FAULTS = (
    *(
        Fault(f"{name.lower()}-{bits}-bits-flipped", "frames",
              f"{name} of the owner with every run of {bits} neighbouring bits flipped", flips(name, bits), "held",
              (REJECTED,), holds=True)
        for name in ("KEEPALIVE", "SETPOINT", "DISARM")
        for bits in (1, 2, 5)
    ),
    Fault("setpoint-of-another-run", "frames", "SETPOINT with the tag of every other run", stale_tags, "held",
          (refused("RUN_TAG"),), holds=True),
    Fault("foreign-setpoint", "frames", "SETPOINT from a node on CAN that greeted nobody",
          foreign_setpoints(greeted=False), "held", (), holds=True),
    Fault("foreign-setpoint-greeted", "frames", "SETPOINT from a greeted node on CAN that does not own the run",
          foreign_setpoints(greeted=True), "held", (refused("OWNER"),), holds=True),
    Fault("setpoint-without-greeting", "frames",
          "SETPOINT from the node on CAN that the run names for it, after a HELLO of another version",
          setpoints_without_greeting, "held", (refused("GREETING"),), frozenset({LINKED}), prepare=steered_from_can,
          holds=True),
    Fault("foreign-keepalives", "frames", "the host is silent, a node on CAN sends its last keep-alives",
          foreign_keepalives, "silence", (_SILENCE,), prepare=recorded),
    Fault("foreign-answers", "frames", "the host is silent, a node on CAN answers the values meant for it",
          foreign_answers, "silence", (_SILENCE,)),
    Fault("foreign-arming", "frames", "EXECUTE ARM from a node on CAN, with guessed nonces and one of its own",
          foreign_arming, "held", (refused("NONCE"),), prepare=disarmed, holds=True),
    Fault("foreign-parameters", "frames", "PARAM_SET and PARAM_COMMIT from a node on CAN", foreign_parameters, "held",
          (refused("OWNER"),), holds=True),
    Fault("foreign-run", "frames", "RUN_BEGIN from a greeted node on CAN", foreign_run, "command",
          (Told("EVENTS", "disarm_cause", COMMAND),)),
    Fault("foreign-disarm", "frames", "DISARM from a node on CAN that greeted nobody", foreign_disarm, "command",
          (Told("EVENTS", "disarm_cause", COMMAND),)),
    Fault("odd-can-frames", "frames", "extended, remote and short CAN frames with identifiers of ours", odd_can_frames,
          "held", (), holds=True),
    Fault("samples-in-a-live-run", "frames", "SAMPLE_A over the owner's link", samples_in_a_live_run, "held", (),
          holds=True),
    Fault("bootloader-while-armed", "frames", "EXECUTE BOOTLOADER with its nonce, over the owner's link",
          asked_and_refused("EXECUTE", "BOOTLOADER"), "held", (refused("BUSY"),), holds=True),
    Fault("save-while-armed", "frames", "EXECUTE SAVE with its nonce, over the owner's link",
          asked_and_refused("EXECUTE", "SAVE"), "held", (refused("BUSY"),), holds=True),
    Fault("arming-replayed", "frames", "EXECUTE ARM, then all frames, that armed the board a moment ago, byte for byte",
          arming_replayed, "held", (refused("NONCE"),), prepare=armed_once_more, holds=True),
    Fault("wild-gains-while-armed", "frames", "every parameter at values that an armed board must not take",
          wild_gains, "held", (refused("ARMED"),), prepare=stiffened, holds=True),
    Fault("wild-pulses", "frames", "PARAM_SET of pulses that drive while disarmed, and a live run nobody arms",
          wild_pulses, "held", (refused("RANGE"),), ESC, prepare=run_ended, holds=True),
)  # fmt: skip
