"""A run belongs to the link that began it: who may arm it, and where its samples and setpoints come from. On the flash
image, in both roles of both links."""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn")

from plumb.boards.virtual_can import MachineBus
from plumb.f103.machine import Machine
from plumb.flash.image import find_image
from plumb.link.identity import NackError
from plumb.link.sample_codec import sample_frames
from plumb.link.session import Session
from plumb.spec import parameters
from support.native_board import AT_REST
from support.noise import with_noise
from support.sessions import BOOT_US, CONTROL, STEER, booted, listen, refusal, used_setpoints

ROLES = ["serial owns", "can owns"]
PERIOD_US = 5000
OWNER, COMMANDED = 1 << 13, 1 << 6
NEUTRAL_US = 1000.0


@pytest.fixture
def machine() -> Machine:
    return booted()


def both(machine: Machine, role: str) -> tuple[Session, Session]:
    """Who owns, and the other one; both greeted."""
    pair = [Session.open(machine.uart), Session.over(MachineBus(machine))]
    pair[0].upload(CONTROL, period_us=PERIOD_US, esc_period_us=2500, arm_hold_ms=0)
    owner, other = pair if role == "serial owns" else reversed(pair)
    return owner, other


def periods(owner: Session, other: Session, each: Callable[[int], None], count: int) -> None:
    """Let so many periods of the board pass, with what `each` does in one of them."""
    for step in range(count):
        each(step)
        listen(owner, PERIOD_US * 1e-6)
        other.receive(0.0)


@pytest.mark.slow
@pytest.mark.parametrize("role", ROLES)
def test_a_greeted_link_does_not_steer_the_run_of_another(machine: Machine, role: str) -> None:
    owner, other = both(machine, role)
    owner.begin("REALTIME_LIVE")
    owner.arm()
    used = used_setpoints(owner)
    other.run_tag = owner.run_tag
    periods(owner, other, lambda _: other.set_setpoint(STEER), 20)
    assert used == []
    assert refusal(lambda: other.request("SETPOINT", 0, STEER, flags=owner.run_tag)) == "OWNER"
    owner.set_setpoint(STEER)
    periods(owner, other, lambda _: None, 5)
    assert used == [STEER]
    assert owner.telemetry["STATUS"]["armed"] == 1


@pytest.mark.slow
@pytest.mark.parametrize("role", ROLES)
def test_the_owner_alone_may_arm_and_anybody_may_stop(machine: Machine, role: str) -> None:
    owner, other = both(machine, role)
    owner.begin("REALTIME_LIVE")
    with pytest.raises(NackError) as refused:
        other.arm()
    assert refused.value.detail & OWNER and "another link began the run" in str(refused.value)
    owner.arm()
    periods(owner, other, lambda _: None, 40)
    assert owner.telemetry["STATUS"]["armed"] == 1
    other.end()
    periods(owner, other, lambda _: None, 40)
    assert (owner.telemetry["STATUS"]["armed"], owner.telemetry["STATUS"]["mode"]) == (0, 0)
    assert owner.telemetry["EVENTS"]["disarm_cause"] == COMMANDED


@pytest.mark.parametrize("role", ROLES)
def test_samples_of_another_link_do_not_count(machine: Machine, role: str) -> None:
    owner, other = both(machine, role)
    owner.begin("REALTIME_INJECTED")
    starved = []

    def inject(step: int) -> None:
        other.frames.write_frames(sample_frames(other.protocol, step, (1700, 2400, 3000, 1, 2, 3)))
        starved.append(owner.telemetry.get("EVENTS", {}).get("starved", 0))

    periods(owner, other, inject, 100)
    assert starved[-1] >= 70
    assert refusal(lambda: other.request("SAMPLE_A", 1, 2, 3)) == "OWNER"
    with pytest.raises(NackError) as refused:
        owner.arm()
    assert refused.value.detail & 1 << 7  # no samples


@pytest.mark.slow
@pytest.mark.parametrize("role", ROLES)
def test_the_owner_names_the_other_link_as_the_source(machine: Machine, role: str) -> None:
    owner, other = both(machine, role)
    owner.begin("REALTIME_INJECTED", elsewhere=("samples", "setpoints"))
    other.run_tag = owner.run_tag
    used, armed = used_setpoints(owner), False

    def inject(step: int) -> None:
        asked = STEER if armed else 0
        frames = other.setpoint_frames(asked) + sample_frames(other.protocol, step, with_noise(AT_REST, step))
        other.frames.write_frames(frames)

    periods(owner, other, inject, 200)
    assert set(used) == {0}
    assert refusal(lambda: owner.request("SAMPLE_A", 1, 2, 3)) == "OWNER"
    assert refusal(lambda: owner.request("SETPOINT", 0, 1, flags=owner.run_tag)) == "OWNER"
    owner.arm()
    armed = True
    periods(owner, other, lambda step: inject(200 + step), 60)
    assert set(used) == {0, STEER}
    assert owner.telemetry["STATUS"]["armed"] == 1
    assert machine.pwm("PB6").pulse_us != NEUTRAL_US
    periods(owner, other, lambda _: None, 40)  # the source falls silent
    assert owner.telemetry["STATUS"]["armed"] == 0
    assert machine.pwm("PB6").pulse_us == NEUTRAL_US
    assert machine.warnings == []


def test_lockstep_has_no_other_source(machine: Machine) -> None:
    owner, _ = both(machine, "serial owns")
    assert refusal(lambda: owner.begin("LOCKSTEP", elsewhere=("samples",))) == "UNSUPPORTED"


def test_a_setpoint_of_another_run_is_refused(machine: Machine) -> None:
    owner, _ = both(machine, "serial owns")
    tags = []
    for run in ("REALTIME_LIVE", "LOCKSTEP", "REALTIME_LIVE"):
        owner.begin(run)
        tags.append(owner.run_tag)
    assert len(set(tags)) == 3 and all(1 <= tag <= 15 for tag in tags)
    used = used_setpoints(owner)
    for tag in range(16):
        if tag != owner.run_tag:
            wrong = owner.frame("SETPOINT", 0, STEER, flags=tag)
            owner.frames.write_frames([wrong])
    listen(owner, 0.1)
    assert used == []
    assert refusal(lambda: owner.request("SETPOINT", 0, STEER, flags=tags[0])) == "RUN_TAG"
    time = owner.protocol["TIME"]
    assert owner.telemetry["TIME"]["run_tag"] == owner.run_tag and time.flags["run_tag"] == (0, 4)
    owner.end()
    listen(owner, 0.2)
    assert owner.telemetry["TIME"]["run_tag"] == 0


@pytest.mark.slow
def test_what_the_arm_switch_began_takes_no_setpoint(machine: Machine) -> None:
    owner, _ = both(machine, "serial owns")
    listen(owner, 0.1)  # open
    machine.drive("PC14", False)
    listen(owner, 1.0)
    assert owner.telemetry["STATUS"]["armed"] == 1
    assert refusal(lambda: owner.request("SETPOINT", 0, STEER, flags=owner.telemetry["TIME"]["run_tag"])) == "OWNER"
    listen(owner, 0.2)
    assert owner.telemetry["STATUS"]["armed"] == 1


def nonces_after_start(machine: Machine) -> tuple[int, ...]:
    """From boot at the same microsecond each time."""
    machine.advance_us(BOOT_US)
    with Session.open(machine.uart) as session:
        return tuple(session.request("CHALLENGE", 16, 0, answer="NONCE", first=16)["nonce"] for _ in range(20))


def test_nonces_do_not_come_again_after_a_reset() -> None:
    """The same board, asked at the same time after each start: reset pin, and loss of power."""
    machine = Machine(find_image())
    seen = [nonces_after_start(machine)]
    for _ in range(4):
        machine.reset()
        seen.append(nonces_after_start(machine))
    for _ in range(2):
        machine.power_cut()
        machine.advance_us(1000)
        machine.power_on()
        seen.append(nonces_after_start(machine))
    assert len({nonce for nonces in seen for nonce in nonces}) == sum(len(nonces) for nonces in seen)


def test_all_words_of_the_table_come_back() -> None:
    """What a link of another owner may still do: read."""
    machine = Machine(find_image())
    machine.advance_us(BOOT_US)
    owner, other = both(machine, "serial owns")
    owner.begin("LOCKSTEP")
    assert len(other.read_parameters()) == len(parameters.table())
