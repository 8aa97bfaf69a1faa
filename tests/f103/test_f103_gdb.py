"""gdb's remote protocol on the simulated chip: where it stops, what it shows, and that a program which was stopped,
stepped and looked into does the same in the same tick as one that was left alone."""

from __future__ import annotations

import ast
import contextlib
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("unicorn")

from unicorn import UC_HOOK_CODE, UC_HOOK_MEM_WRITE

from plumb import f103
from plumb.errors import LinkError, UsageError
from plumb.f103.core.bus import SimulationError
from plumb.f103.debug_hold import REGISTERS
from plumb.f103.gdb_description import PACKET_BYTES
from plumb.f103.gdb_server import GdbServer
from plumb.f103.machine import Machine
from support.f103_program import NewBoard
from support.gdb_client import GdbClient

SP, LR, PC = 13, 14, 15
NUMBERS = {name: number for number, name in enumerate(REGISTERS)}
RESULTS = 0x20000000
RUN_US = 8000


@pytest.fixture
def said() -> list[str]:
    return []


@contextlib.contextmanager
def debugged(machine: Machine, said: list[str], run_us: float = RUN_US) -> Iterator[GdbClient]:
    """A client that has stopped the machine; behind it the machine has run until run_us."""
    server = machine.debug(GdbServer(waits=True, say=said.append))
    end = machine.now + round(run_us * 40320)
    thread = threading.Thread(target=machine.run_to, args=(end,), daemon=True)
    with GdbClient(server.port) as client:
        thread.start()
        assert client.ask("?") == "T05"
        yield client
    thread.join(60)
    assert not thread.is_alive()
    server.close()


def symbols(elf: Path) -> dict[str, int]:
    lines = subprocess.run(["arm-none-eabi-nm", str(elf)], capture_output=True, text=True, check=True).stdout
    return {words[2]: int(words[0], 16) & ~1 for words in map(str.split, lines.splitlines()) if len(words) == 3}


def state(machine: Machine) -> tuple[object, ...]:
    cpu, nvic = machine.cpu, machine.nvic
    registers = [cpu.uc.reg_read(REGISTERS[name]) for name in list(REGISTERS)[:13]]
    return machine.now, cpu.instructions, cpu.pc, cpu.stack, registers, nvic.active, nvic.pending, bytes(cpu.ram)


def times_at(machine: Machine, address: int, run_us: float = RUN_US) -> list[int]:
    """When the instruction at an address begins, in ticks; seen from inside Unicorn, in one run."""
    cpu, times = machine.cpu, list[int]()
    cpu.uc.hook_add(UC_HOOK_CODE, lambda *_: times.append(machine.now - cpu.instruction_ticks), None, address, address)
    machine.advance_us(run_us)
    return times


def ticks_at_stop(client: GdbClient, machine: Machine) -> int:
    client.ask("?")  # the answer comes from a machine that stands
    return machine.now


def test_a_breakpoint_stops_in_the_tick_at_which_a_free_run_gets_there(
    board: NewBoard, build: Callable[[str], Path], said: list[str]
) -> None:
    handler = symbols(build("systick"))["systick_handler"]
    expected = times_at(board("systick").machine, handler)
    free, b = board("systick").machine, board("systick").machine
    free.advance_us(RUN_US)
    with debugged(b, said) as gdb:
        assert gdb.ask(f"Z0,{handler:x},2") == "OK"
        stops: list[int] = []
        while len(stops) < len(expected):
            assert gdb.ask("vCont;c") == "T05"
            assert gdb.register(PC) == handler
            stops.append(ticks_at_stop(gdb, b))
            assert gdb.ask(f"z0,{handler:x},2") == "OK"
            assert gdb.ask("s") == "T05"
            assert gdb.ask(f"Z1,{handler:x},2") == "OK"
            assert gdb.ask(f"z1,{handler:x},2") == "OK"
            assert gdb.ask(f"Z0,{handler:x},2") == "OK"
        assert gdb.ask("D") == "OK"
    assert len(expected) >= 3
    assert stops == expected
    assert state(b) == state(free)
    assert said == []


@pytest.mark.parametrize(
    ("program", "start_us", "steps"),
    [(name, 0.0, 2000) for name in ("nesting", "systick", "tasks", "wwdg", "bits", "adc")]
    + [(name, 5000.0, 100) for name in ("systick", "tasks")],
)
def test_a_program_that_is_stepped_is_the_same(
    board: NewBoard, program: str, start_us: float, steps: int, said: list[str]
) -> None:
    """Single steps through start-up, sleep, masks and both stacks, then a run to the end."""
    free, b = (board(program, faults="run").machine for _ in range(2))
    b.advance_us(start_us)
    free.advance_us(start_us)
    free.advance_us(5 * RUN_US)
    with debugged(b, said, 5 * RUN_US) as gdb:
        for _ in range(steps):
            assert gdb.ask("vCont;s:1;c") in ("T05", "T0b")
        gdb.ask("D")
    assert state(b) == state(free)


def test_a_step_passes_over_exceptions(board: NewBoard, build: Callable[[str], Path], said: list[str]) -> None:
    """Whoever steps through main stays in main; the handlers have run to their end all the same."""
    places = symbols(build("nesting"))
    handlers = {place: name for name, place in places.items() if name.endswith("_handler")}
    b = board("nesting").machine
    with debugged(b, said) as gdb:
        assert gdb.ask(f"Z0,{places['main']:x},2") == "OK"
        assert gdb.ask("c") == "T05"
        assert gdb.ask(f"z0,{places['main']:x},2") == "OK"
        for _ in range(300):
            gdb.ask("s")
            assert gdb.register(NUMBERS["xpsr"]) & 0x1FF == 0
            assert gdb.register(PC) not in handlers
        gdb.ask("D")
    assert bytes(b.cpu.ram[:8]) == b"a(h)bct1"


def test_a_step_leaves_a_breakpoint_behind_it(board: NewBoard, build: Callable[[str], Path], said: list[str]) -> None:
    main = symbols(build("nesting"))["main"]
    with debugged(board("nesting").machine, said) as gdb:
        assert gdb.ask(f"Z0,{main:x},2") == "OK"
        for how in ("c", "c", "vCont;c"):
            assert gdb.ask(how) == "T05"
            assert gdb.register(PC) == main, "no instruction was made"
        assert gdb.ask("s") == "T05"
        assert gdb.register(PC) > main
        gdb.ask("D")


@pytest.mark.parametrize("code", [b"\x62\xb6", b"\x30\xbf"], ids=["behind the sleep", "the sleep"])
def test_a_breakpoint_around_the_sleep_of_a_masked_core(
    board: NewBoard, build: Callable[[str], Path], code: bytes, said: list[str]
) -> None:
    """CPSIE behind WFI: the machine computes it without Unicorn, unless somebody wants to stop there."""
    image = build("systick").with_suffix(".bin").read_bytes()
    main = symbols(build("systick"))["main"]
    place = 0x08000000 + image.index(code, main - 0x08000000)
    reference = board("systick").machine
    reference.cpu.loops_at_once = False
    expected = times_at(reference, place)
    free, b = board("systick").machine, board("systick").machine
    free.advance_us(RUN_US)
    assert state(free) == state(reference)
    stops = []
    with debugged(b, said) as gdb:
        for _ in expected:
            assert gdb.ask(f"Z0,{place:x},2") == "OK"
            assert gdb.ask("c") == "T05"
            stops.append(ticks_at_stop(gdb, b))
            assert gdb.ask(f"z0,{place:x},2") == "OK"
            assert gdb.ask("s") == "T05"
        gdb.ask("D")
    assert len(expected) > 3
    assert stops == expected
    assert state(b) == state(free)


def test_watchpoints_stop_behind_the_access(board: NewBoard, build: Callable[[str], Path], said: list[str]) -> None:
    """results[0] is the count of ticks, which the handler writes; main reads the count itself."""
    free, b = board("systick").machine, board("systick").machine
    written: list[int] = []
    free.cpu.uc.hook_add(UC_HOOK_MEM_WRITE, lambda *_: written.append(free.now), None, RESULTS, RESULTS + 3)
    free.advance_us(RUN_US)
    ticks = int.from_bytes(free.cpu.ram[:4], "little")
    with debugged(b, said) as gdb:
        assert gdb.ask(f"Z1,{symbols(build('systick'))['systick_handler']:x},2") == "OK"
        assert gdb.ask("c") == "T05"
        assert gdb.ask(f"z1,{symbols(build('systick'))['systick_handler']:x},2") == "OK"
        assert gdb.ask(f"Z2,{RESULTS:x},4") == "OK"
        assert gdb.ask("c") == f"T05watch:{RESULTS:x};"
        assert gdb.word(RESULTS) == 1
        assert ticks_at_stop(gdb, b) == written[-ticks]
        assert gdb.ask("c") == f"T05watch:{RESULTS:x};"
        assert gdb.word(RESULTS) == 2
        assert gdb.ask(f"z2,{RESULTS:x},4") == "OK"
        count = symbols(build("systick"))["ticks"]
        assert gdb.ask(f"Z3,{count:x},4") == "OK"
        assert gdb.ask("c") == f"T05rwatch:{count:x};"
        assert gdb.ask(f"z3,{count:x},4") == "OK"
        assert gdb.ask(f"Z4,{count:x},1") == "OK"
        assert gdb.ask("c").startswith("T05awatch:")
        gdb.ask("D")
    assert state(b) == state(free)


def test_a_watched_register_of_a_peripheral(board: NewBoard, said: list[str]) -> None:
    bsrr = 0x40011010
    b = board("hello").machine
    with debugged(b, said) as gdb:
        assert gdb.ask(f"Z2,{bsrr:x},4") == "OK"
        assert gdb.ask("c") == f"T05watch:{bsrr:x};"
        assert gdb.word(0x4001100C) & 1 << 13
        assert "GPIOC 15..0  - - 1" in gdb.monitor("pins")
        gdb.ask("D")


def test_registers_of_the_core(board: NewBoard, said: list[str]) -> None:
    b = board("tasks").machine
    with debugged(b, said, 20_000) as gdb:
        values = bytes.fromhex(gdb.ask("g"))
        assert len(values) == 4 * len(REGISTERS)
        assert int.from_bytes(values[4 * PC :][:4], "little") == b.cpu.pc
        while not gdb.register(NUMBERS["control"]):
            gdb.ask("s")
        assert gdb.register(SP) == gdb.register(NUMBERS["psp"]) != gdb.register(NUMBERS["msp"])
        gdb.ask("D")


def test_written_registers_are_those_that_the_program_goes_on_with(board: NewBoard, said: list[str]) -> None:
    b = board("systick").machine
    b.advance_us(1500)
    ticks = b.cpu.ram[0]
    with debugged(b, said) as gdb:
        gdb.ask("s")
        for name, value in (("r5", 0x12345678), ("primask", 1), ("basepri", 0x40), ("sp", 0x20004000)):
            kept = gdb.register(NUMBERS[name])
            assert gdb.ask(f"P{NUMBERS[name]:x}={value.to_bytes(4, 'little').hex()}") == "OK"
            assert gdb.register(NUMBERS[name]) == value
            assert gdb.ask(f"P{NUMBERS[name]:x}={kept.to_bytes(4, 'little').hex()}") == "OK"
        whole = gdb.ask("g")
        assert gdb.ask("G" + whole) == "OK"
        assert gdb.ask("g") == whole
        pc = gdb.register(PC)
        assert gdb.ask(f"P{PC:x}={(pc + 2).to_bytes(4, 'little').hex()}") == "OK"
        assert gdb.register(PC) == pc + 2
        assert gdb.ask(f"P{PC:x}={pc.to_bytes(4, 'little').hex()}") == "OK"
        gdb.ask("D")
    assert b.cpu.ram[0] > ticks + 2


def test_memory_is_read_and_written_where_it_can_be(board: NewBoard, said: list[str]) -> None:
    b = board("hello").machine
    with debugged(b, said, 100) as gdb:
        assert gdb.ask("m8000000,8") == bytes(b.cpu.flash[:8]).hex() == gdb.ask("m0,8")
        assert gdb.ask("M20000100,3:010203") == "OK"
        assert gdb.ask("X20000103,3:\x7d\x03\x7d\x04}]") == "OK"
        assert gdb.ask("m20000100,6") == "010203" + b"#$}".hex()
        assert gdb.ask("M8000000,4:00000000") == "E01"
        assert bytes(b.cpu.flash[:4]) != bytes(4)
        assert gdb.ask(f"m{RESULTS + len(b.cpu.ram) - 2:x},8") == bytes(b.cpu.ram[-2:]).hex(), "up to its end"
        assert gdb.ask("m60000000,4") == "E01"
        assert gdb.ask("M60000000,4:00000000") == "E01"
        assert gdb.word(0xE0042000) == 0x20036410, "a debugger reads the device id"
        gdb.ask("D")


@pytest.mark.parametrize("faults", ["stop", "run"])
def test_a_fault_stops_with_what_it_is(board: NewBoard, faults: str, said: list[str]) -> None:
    """And goes on in its handler, also where a run without a debugger ends with it."""
    program = board("fault", faults=faults)
    b = program.machine
    program.ask(0, 1)
    program.ask(7, 0)
    with debugged(b, said) as gdb:
        assert gdb.ask("c") == "T0b"
        assert "PRECISERR" in gdb.monitor("faults")
        assert gdb.register(NUMBERS["xpsr"]) & 0x1FF == 3
        assert gdb.ask("s") == "T05"
        gdb.ask("D")
    assert program.result(2) == 3


def test_what_is_not_modelled_stops_before_it_ends_the_run(board: NewBoard) -> None:
    b = board("hello").machine
    b.bus.writers.pop(0x40011010)
    server = b.debug(GdbServer(waits=True))
    ended: list[SimulationError] = []

    def run() -> None:
        try:
            b.advance_us(RUN_US)
        except SimulationError as error:
            ended.append(error)

    thread = threading.Thread(target=run)
    with GdbClient(server.port) as gdb:
        thread.start()
        assert gdb.ask("c") == "T0b"
        assert ended == []
        gdb.ask("D")
    thread.join(60)
    server.close()
    assert "not modelled" in str(ended[0])


def test_registers_whose_reading_has_an_effect_say_what_they_hold_without_it() -> None:
    """A `read_NAME` that writes to its peripheral has a `peek_NAME` beside it, which does not."""
    folder = Path(f103.__file__).parent
    acting, quiet = set(), set()
    for path in [*folder.glob("core/*.py"), *folder.glob("peripherals/*.py")]:
        for kind in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            for method in kind.body if isinstance(kind, ast.ClassDef) else []:
                if isinstance(method, ast.FunctionDef) and method.name.startswith(("read_", "peek_")):
                    name = path.stem, method.name[5:]
                    if method.name.startswith("peek_"):
                        assert not writes(method), f"{name}: peeking writes"
                        quiet.add(name)
                    elif writes(method):
                        acting.add(name)
    assert len(acting) > 8
    assert acting - SAME <= quiet


SAME = {("crc", "dr")}
"""Reading computes what was put off, and changes nothing that could be seen."""


def writes(method: ast.FunctionDef) -> bool:
    return any(isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) for node in ast.walk(method))


def test_a_reset_by_the_monitor(board: NewBoard, said: list[str]) -> None:
    b = board("hello").machine
    b.advance_us(1000)
    with debugged(b, said) as gdb:
        resets, now = b.reset_count, b.now
        assert "reset" in gdb.monitor("reset")
        assert (b.reset_count, b.now) == (resets + 1, now)
        assert gdb.register(PC) == int.from_bytes(b.cpu.flash[4:8], "little") & ~1
        assert gdb.monitor("time").startswith(f"{b.now_us:.3f} us")
        assert gdb.monitor("dance").startswith("there is no 'dance'")
        gdb.send("k")
    assert b.uart.in_waiting
    assert said == []


def test_an_interrupt_of_gdb_stops_a_run(board: NewBoard, said: list[str]) -> None:
    b = board("systick").machine
    with debugged(b, said, 3e6) as gdb:
        gdb.send("c")
        time.sleep(0.1)
        gdb.raw(b"\x03")
        assert gdb.answer() == "T02"
        stood = b.now
        time.sleep(0.05)
        assert b.now == stood > 0
        gdb.ask("D")


def test_descriptions_are_read_in_pieces(board: NewBoard, said: list[str]) -> None:
    with debugged(board("hello").machine, said, 100) as gdb:
        assert f"PacketSize={PACKET_BYTES:x}" in gdb.ask("qSupported:swbreak+")
        text, piece = "", "m"
        while piece[0] == "m":
            piece = gdb.ask(f"qXfer:features:read:target.xml:{len(text):x},40")
            text += piece[1:]
        assert text.count("<reg ") == len(REGISTERS)
        assert "org.gnu.gdb.arm.m-profile" in text
        assert '"rom" start="0x8000000" length="0x10000"' in gdb.ask("qXfer:memory-map:read::0,800")
        assert gdb.ask("vMustReplyEmpty") == ""
        assert gdb.ask("QStartNoAckMode") == "OK"
        gdb.send("?")
        assert gdb.byte() == b"$", "no acknowledgement any more"
        gdb.send("D")


HOSTILE = {
    "half": (b"$m2000", False),
    "no protocol": (b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", True),
    "no end": (b"$" + b"a" * (3 * PACKET_BYTES), True),
    "no checksum": (b"$g#zz$g#zz", True),
    "nothing": (b"", False),
}
"""What it sends, and whether it is sent away for that."""


@pytest.mark.parametrize(("data", "hangs_up"), HOSTILE.values(), ids=HOSTILE)
def test_a_client_that_is_none_is_one_sentence_and_the_run_goes_on(
    board: NewBoard, data: bytes, hangs_up: bool, said: list[str]
) -> None:
    free, b = board("hello").machine, board("hello").machine
    free.advance_us(RUN_US)
    with debugged(b, said) as gdb:
        assert gdb.ask(f"Z0,{b.cpu.pc + 2:x},2") == "OK"
        gdb.raw(data)
        if hangs_up:
            with pytest.raises(ConnectionResetError):
                while gdb.byte():
                    pass
    assert state(b) == state(free)
    assert len(said) == 1
    assert said[0].endswith("its breakpoints are dropped, and the board runs on")


@pytest.mark.parametrize(
    "packet",
    ["m0,ffffffffffff", "mffffffff,8", "m0", "mx,y", "M0,", "X20000000,5:a", "p99", "P3=xx", "P=", "G00", "Gzz",
     "Z0,ffffffffffffff,2", "Z2,20000000,ffffffff", "Z9,0,0", "Zx", "z0,1,2", "qRcmd,zz",
     "qXfer:features:read:target.xml:x,y", "qXfer:features:read:other.xml:0,10", "vFlashErase:08000000,400", "Hg0",
     "T1", "\xff\xfe"],
)  # fmt: skip
def test_a_bad_packet_has_an_answer(board: NewBoard, packet: str, said: list[str]) -> None:
    b = board("hello").machine
    with debugged(b, said, 100) as gdb:
        assert len(gdb.ask(packet)) <= PACKET_BYTES
        gdb.raw(b"$?#00")
        assert gdb.byte() == b"-", "a packet with a wrong checksum is asked for again"
        assert gdb.ask("?") == "T05"
        gdb.ask("D")
    assert said == []


def test_a_second_debugger_is_sent_away_and_the_next_one_served(board: NewBoard, said: list[str]) -> None:
    b = board("hello").machine
    server = b.debug(GdbServer(say=said.append))
    stop = threading.Event()
    thread = threading.Thread(target=lambda: b.run_until(stop.is_set, 1e9), daemon=True)
    thread.start()
    for _ in range(2):
        with GdbClient(server.port) as first:
            assert first.ask("?") == "T05"
            with GdbClient(server.port) as second, pytest.raises(OSError):
                second.ask("?")
            first.ask("D")
    stop.set()
    thread.join(60)
    server.close()
    assert said == []


def test_a_taken_port_is_one_sentence(board: NewBoard) -> None:
    server = board("hello").machine.debug()
    with pytest.raises(LinkError, match=f"port {server.port} of 127.0.0.1.*choose another port"):
        GdbServer(server.port)
    server.close()


@pytest.mark.parametrize("port", [-1, 65536, 10**17])
def test_a_number_that_is_no_port_is_wrong_use(port: int) -> None:
    with pytest.raises(UsageError, match=f"port {port}: give a number up to 65535, or 0$"):
        GdbServer(port)


def test_snapshots_leave_the_debugger_where_it_is(board: NewBoard, said: list[str]) -> None:
    b = board("systick").machine
    before = b.snapshot()
    with debugged(b, said) as gdb:
        assert gdb.ask(f"Z2,{RESULTS:x},4") == "OK"
        assert gdb.ask("c") == f"T05watch:{RESULTS:x};"
        b.restore(before)  # it stands between two steps
        assert gdb.ask("c") == f"T05watch:{RESULTS:x};"
        assert not b.cpu.loops_at_once, "as long as there are points"
        gdb.ask("D")
    hold = b.debug_hold
    b.restore(before)
    assert b.debug_hold is hold is not None
