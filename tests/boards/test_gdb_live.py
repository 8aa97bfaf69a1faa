"""gdb on the flash image while it is armed and drives its plant: every frame, pulse and byte of RAM comes in the tick
in which it comes without gdb."""

from __future__ import annotations

import re
import shutil
import subprocess
import threading
from collections.abc import Iterator

import pytest

pytest.importorskip("unicorn")

from plumb import systems
from plumb.boards import plant_on_pins
from plumb.boards.virtual import VirtualBoard
from plumb.contract.parameters import quantise
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.debug_hold import DebugHold
from plumb.f103.gdb_server import GdbServer
from plumb.f103.snapshot import Snapshot
from plumb.systems.contracts import PINS
from support.flash_image import image_path
from support.gdb_client import GdbClient

GDB = shutil.which("gdb-multiarch")
LOOK_US = 100
TRAFFIC_S = 0.06
STEP = "plumb_quad_step"
EXPECTED = (
    r"Breakpoint 1, control_step \(",
    r"\$1 = \d+",
    r"primask +0x0",
    r"\d+\s+plumb_quad_step\(",
    r"run_steps \(",
    r"Hardware watchpoint 2: -location control.quad.words.step\n\nOld value = (\d+)\nNew value = (?!\1\n)\d+",
    r"#0 +(0x\w+ in )?plumb_quad_step",
    r"#1 +0x\w+ in control_step",
    r"\d+\.\d+ us, \d+ instructions",
    r"the program took no fault",
    r"detached",
)
"""What the session below prints, in this order."""

Live = tuple[VirtualBoard, Snapshot, list[object]]


@pytest.fixture(scope="module", params=[("quad", "serial"), ("quad", "can")], ids=lambda param: "-".join(param))
def live(request: pytest.FixtureRequest) -> Iterator[Live]:
    """A board that flies, a snapshot of it, and what it does from then on when it is left alone."""
    name, link = request.param
    system, joined = systems.load(name), systems.load(name, PINS)
    run = system.scenario(joined.SCENARIO, 1, seconds=5.0)
    with VirtualBoard(link=link) as board:
        params = quantise(system.TUNINGS[joined.TUNING])
        session = plant_on_pins.configure_as(board, params, period_us=run.period_us, arm_hold_ms=0, **system.LINK)
        joined.couple(board.machine, system.plant(run))
        board.machine.advance_us(plant_on_pins.FOUND_US)
        session.begin("REALTIME_LIVE", frames=joined.FRAMES)
        session.arm()
        traffic(board, 0.1)
        snapshot = board.machine.snapshot(session)
        alone = traffic(board)
        yield board, snapshot, alone


def traffic(board: VirtualBoard, seconds: float = TRAFFIC_S) -> list[object]:
    """Every frame with the time it came, every change of the pulses, and what the run leaves in memory."""
    machine, session, received = board.machine, board.session, []
    pins: list[object] = []

    def look(now: int) -> None:
        levels = (machine.pwm("PB6"), machine.pwm("PB7"))
        if not pins or pins[-1] != levels:
            pins.append(levels)
        machine.timeline.at("look", now + LOOK_US * TICKS_PER_US, look)

    look(machine.now)
    session.set_setpoint(1 << 24)
    end_s = session.clock() + seconds
    while session.clock() < end_s:
        received.append((session.clock(), session.receive(0.002)))
    machine.timeline.cancel("look")
    return [received, pins, machine.now, machine.cpu.instructions, bytes(machine.cpu.ram), list(machine.warnings)]


def test_stops_steps_and_watches_leave_every_step_and_its_time_as_they_are(live: Live) -> None:
    board, snapshot, alone = live
    machine = board.machine
    machine.restore(snapshot)
    said: list[str] = []
    server = machine.debug(GdbServer(waits=True, say=said.append))
    stops: list[int] = []
    failed: list[BaseException] = []

    def debug() -> None:
        try:
            with GdbClient(server.port) as gdb:
                step = _address(STEP)
                for _ in range(10):
                    assert gdb.ask(f"Z1,{step:x},2") == "OK"
                    assert gdb.ask("c") == "T05"
                    assert gdb.register(15) == step
                    stops.append(machine.now)
                    assert gdb.ask(f"z1,{step:x},2") == "OK"
                    words = gdb.register(0)
                    for _ in range(40):
                        assert gdb.ask("s") == "T05"
                    assert gdb.ask(f"Z2,{words:x},40") == "OK"
                    assert gdb.ask("c").startswith("T05watch:")
                    assert gdb.ask(f"z2,{words:x},40") == "OK"
                gdb.ask("D")
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=debug)
    thread.start()
    stopped = traffic(board)
    thread.join(60)
    server.close()
    assert not failed and not said
    assert len(set(stops)) == 10
    assert stopped == alone


def test_looking_at_every_register_and_all_memory_changes_nothing(live: Live) -> None:
    """Also at those whose reading has an effect: a received byte, a flag of the SysTick, an error of a bus."""
    board, snapshot, alone = live
    machine = board.machine
    machine.restore(snapshot)
    hold = DebugHold(machine, machine.run_to, GdbServer())
    addresses = sorted(machine.bus.peekers)
    looks = 0

    def look(now: int) -> None:
        nonlocal looks
        looks += 1
        for address in addresses:
            assert len(hold.read(address, 4)) == 4
        hold.read(0x20000000, 0x5000)
        machine.timeline.at("debugger", now + 1733 * TICKS_PER_US, look)

    look(machine.now)
    looked_at = traffic(board)
    machine.timeline.cancel("debugger")
    assert looks > 30
    assert looked_at == alone


@pytest.mark.skipif(GDB is None, reason="gdb-multiarch is not installed")
def test_a_session_of_gdb(live: Live) -> None:
    """Break in the step, print its record, next, finish, watch, detach."""
    board, snapshot, alone = live
    machine = board.machine
    machine.restore(snapshot)
    server = machine.debug(GdbServer(waits=True))
    commands = [
        "set pagination off", f"target extended-remote 127.0.0.1:{server.port}", "break control_step", "continue",
        "print c->quad.words.step", "info registers primask msp", "next", "finish", "delete 1",
        "watch -location control.quad.words.step", "continue", "backtrace 2", "monitor time", "monitor faults",
        "delete", "detach",
    ]  # fmt: skip
    words = [word for command in commands for word in ("-ex", command)]
    assert GDB is not None
    gdb = subprocess.Popen(
        [GDB, "-batch", "-nx", str(image_path().with_suffix(".elf")), *words],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    stopped = traffic(board)
    said, _ = gdb.communicate(timeout=60)
    server.close()
    assert stopped == alone
    rest = said
    for expected in EXPECTED:
        found = re.search(expected, rest)
        assert found is not None, f"{expected} is not there, or too early:\n{said}"
        rest = rest[found.end() :]


def _address(name: str) -> int:
    elf = str(image_path().with_suffix(".elf"))
    lines = subprocess.run(["arm-none-eabi-nm", elf], capture_output=True, text=True, check=True).stdout.splitlines()
    return next(int(line.split()[0], 16) & ~1 for line in lines if line.split()[-1] == name)
