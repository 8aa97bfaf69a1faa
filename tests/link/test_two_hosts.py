"""Random sequences of what two hosts, their lines and the power supply do to the shipped loop, against a model of the
board that is written from docs/reference/protocol.md. Hypothesis shortens a sequence that fails.

The sequences are the same every time; PLUMB_LONG=1 draws new ones for some minutes.
"""

from __future__ import annotations

from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from plumb.boards.native.mcu import State
from plumb.link.identity import BLOCKING_FAULTS
from plumb.spec import parameters
from support.campaigns import LONG, campaign
from support.two_hosts import IDENTITY_MS, Link, TwoHosts
from support.two_hosts_model import CLOSED, COMMAND, HELLO, SAMPLES, SENSORS_SAY, SILENCE, BoardModel, LinkModel

STATUS_MS = 105
"""An open link gets STATUS and EVENTS every 100 ms."""
SAFE_US = 50_000
"""Outputs are neutral so long after the last keep-alive that counted; a host of this test answers every millisecond."""
CAN_SILENCE_US = 2_000_000
READY_MS = 3000
NEUTRAL = 2000
MODES = {None: 0, "LOCKSTEP": 1, "REALTIME_INJECTED": 2, "REALTIME_LIVE": 2}
DEFAULTS = [row.default for row in parameters.table()]
ROWS = {row.name: place for place, row in enumerate(parameters.table())}
VALUES = [("period_us", value) for value in (2500, 5000, 20_000)] + [("arm_hold_ms", value) for value in (0, 300)]
LIVE = [("pid.kp_q22", value) for value in (5, 67947725, 100_000_000, 40_000_000)]
"""May change during a run in real time; while it is armed, to at most twice and at least half."""
ASKER = 0xA5F00001
"""What a host draws at random for CHALLENGE."""
NEED_GREETING = ("PARAM_SET", "PARAM_COMMIT", "RUN_BEGIN", "SAMPLE_A", "SETPOINT")

links = st.sampled_from(Link)


class Hosts(RuleBasedStateMachine):
    sequences = 0
    """How many were begun: the test must have tried that many."""

    def __init__(self) -> None:
        super().__init__()
        self.hosts = TwoHosts(self.each_ms, self.on_frame)
        self.model = BoardModel(list(DEFAULTS), 0)
        self.saved: list[int] | None = None
        self.alive = False
        self.counted_us = 0
        self.values: list[tuple[int, int]] = []
        self.status: dict[Link, dict[str, int]] = {}
        self.events: dict[Link, dict[str, int]] = {}
        self.damaged = False

    # ---- what holds in every millisecond ----

    def each_ms(self) -> None:
        wires = self.hosts.wires
        pulses = set(wires.pulse_halfus)
        if not wires.armed:
            assert pulses <= {0, NEUTRAL} and not wires.bridge_on and wires.duty_q15 == 0
        silent_us = self.hosts.now_us - self.counted_us
        if silent_us > SAFE_US:
            assert not wires.armed and pulses <= {0, NEUTRAL}, f"armed {silent_us} us after the last keep-alive"

    def on_frame(self, link: Link, name: str, said: dict[str, int]) -> None:
        if name == "KEEPALIVE_VALUE":
            assert link is self.model.owner
            if self.alive:
                self.values.append((said["arming"], said["value"]))
                self.answer(link, said["arming"], said["value"])
        elif name == "ACK" and said["request"] == self.hosts.protocol["EXECUTE"].identifier and said["detail"] > 0xFFFF:
            self.counted_us = self.hosts.now_us  # armed
        elif name == "STATUS":
            self.status[link] = said
        elif name == "EVENTS":
            self.events[link] = said

    def answer(self, link: Link, arming: int, value: int) -> None:
        self.hosts.put(link, self.hosts.sealed(link, "KEEPALIVE", arming, value))
        self.model.link[link].received_us = self.counted_us = self.hosts.now_us

    def pass_ms(self, count: int) -> None:
        """Time passes; a CAN link that is silent for too long closes."""
        can = self.model.link[Link.CAN]
        for _ in range(count):
            self.hosts.pass_ms()
            if can.open and self.hosts.now_us - can.received_us > CAN_SILENCE_US:
                self.hosts.pass_ms(3)
                self.model.link[Link.CAN] = LinkModel()
                self.model.lose(Link.CAN, CLOSED)
        if self.model.armed and self.hosts.now_us - self.counted_us > SAFE_US:
            self.model.disarm(SILENCE)

    # ---- what holds after every rule ----

    @invariant()
    def board_reports_what_the_model_has(self) -> None:
        if self.hosts.mcu.state is not State.RUNNING:
            return
        model, fault = self.model, self.damaged
        before = ""
        while before != repr(model):  # what time alone changes has happened when a STATUS is built
            before = repr(model)
            self.status.clear()
            self.events.clear()
            self.pass_ms(STATUS_MS)
        assert bool(self.hosts.wires.armed) == model.armed
        assert not model.armed or (model.run in ("REALTIME_LIVE", "REALTIME_INJECTED"))
        for link in Link:
            if not model.link[link].open:
                assert link not in self.status, f"{link.name} is closed"
                continue
            said = self.status[link]
            assert said["mode"] == MODES[model.run]
            assert bool(said["armed"]) == model.armed
            assert bool(said["live"]) == (model.run == "REALTIME_LIVE")
            assert bool(said["staged"]) == (model.staged is not None)
            assert bool(said["read_only"]) == model.link[link].read_only
            assert bool(said["faults"] & sum(1 << bit for bit in BLOCKING_FAULTS)) == fault
            free = SENSORS_SAY | (SAMPLES if model.run == "REALTIME_INJECTED" else 0)
            assert said["blocked"] & ~free == model.blocked(link, fault)
            if not model.armed:
                assert self.events[link]["disarm_cause"] == model.cause

    # ---- requests, as the protocol answers them ----

    def ask(
        self, link: Link, name: str, *words: int, flags: int = 0, answer: str = "ACK"
    ) -> tuple[str, dict[str, int]] | None:
        """Ask, and see that what needs an open link or a greeting is refused without."""
        there = self.model.link[link]
        opens = link is Link.CAN and name == "HELLO"
        said = self.hosts.ask(link, name, *words, flags=flags, answer=answer,
                              limit_ms=IDENTITY_MS if answer == "IDENTITY" else 10)  # fmt: skip
        if not (there.lets_in or opens or name == "DISARM"):
            assert said is None, f"{name} over a {link.name} that does not let it in"
            return None
        there.received_us = self.hosts.now_us
        there.open = there.open or opens
        assert said is not None, f"{name} over {link.name} is not answered"
        if name in NEED_GREETING and not there.greeted:
            assert self.reason(said) == "GREETING"
        return said

    def reason(self, said: tuple[str, dict[str, int]] | None) -> str:
        """Of a NACK; empty for a yes, and "closed" where there is no answer."""
        if said is None:
            return "closed"
        return self.hosts.protocol["NACK"].choice("reason", said[1]["reason"]) if said[0] == "NACK" else ""

    def with_nonce(self, link: Link, request: str, verb: str) -> tuple[str, dict[str, int]] | None:
        number = self.hosts.protocol["CHALLENGE"].value("verb", verb)
        said = self.ask(link, "CHALLENGE", number, ASKER, answer="NONCE")
        return self.ask(link, request, number, said[1]["nonce"] ^ ASKER if said else 1)

    # ---- rules: connect and disconnect ----

    @rule(command=st.sampled_from("OLC"))
    def text_command(self, command: str) -> None:
        accepted = self.hosts.accepted
        self.hosts.text(command.encode() + b"\r")
        self.pass_ms(2)
        assert self.hosts.accepted == accepted + 1
        there = self.model.link[Link.UART]
        if command == "C" or (there.read_only and command == "O"):
            there.greeted = False
        there.open, there.read_only = command != "C", command == "L"
        if command != "O":
            self.model.lose(Link.UART, CLOSED)

    @rule(link=links, version=st.sampled_from([0, 0, 0, 1, -1]), other_hash=st.sampled_from([0, 0, 0, 1]))
    def hello(self, link: Link, version: int, other_hash: int) -> None:
        protocol = self.hosts.protocol
        said = self.ask(link, "HELLO", protocol.version + version, protocol.dbc_hash ^ other_hash, answer="IDENTITY")
        if said is None:
            return
        self.model.link[link].greeted = good = not (version or other_hash)
        if not good:
            self.model.lose(link, HELLO)
        if self.model.staged_by is link:
            self.model.staged = None
        self.read_back(link)

    @rule()
    def close_can(self) -> None:
        if self.ask(Link.CAN, "CLOSE", 0, 0):
            self.model.link[Link.CAN] = LinkModel()
            self.model.lose(Link.CAN, CLOSED)

    def read_back(self, link: Link) -> None:
        """The parameters in use, asked for over an open link."""
        for name in ("period_us", "arm_hold_ms", "pid.kp_q22"):
            said = self.ask(link, "PARAM_GET", ROWS[name], 0, answer="PARAM_VALUE")
            assert said is None or said[1]["value"] == self.model.in_use[ROWS[name]]

    # ---- rules: parameters ----

    @rule(link=links, row=st.sampled_from(VALUES + LIVE))
    def stage(self, link: Link, row: tuple[str, int]) -> None:
        model, place = self.model, ROWS[row[0]]
        if self.reason(self.ask(link, "PARAM_SET", place, row[1], answer="PARAM_STAGED")) == "":
            if model.staged is None or model.staged_by is not link:
                model.staged, model.staged_by = list(model.in_use), link
            model.staged[place] = row[1]

    @rule(link=links, row=st.sampled_from([("period_us", 0), ("arm_hold_ms", 1 << 31)]))
    def stage_out_of_range(self, link: Link, row: tuple[str, int]) -> None:
        assert self.reason(self.ask(link, "PARAM_SET", ROWS[row[0]], row[1], answer="PARAM_STAGED")) != ""

    @rule(link=links, wrong=st.sampled_from([0, 0, 0, 1]))
    def commit(self, link: Link, wrong: int) -> None:
        model = self.model
        result = model.in_use if model.staged is None else model.staged
        reason = self.reason(self.ask(link, "PARAM_COMMIT", len(result), parameters.crc32(result) ^ wrong))
        if model.link[link].lets_in and model.link[link].greeted:
            assert reason == (self.forbidden(link, result) or ("CRC" if wrong else ""))
        if reason == "":
            model.in_use, model.staged, model.source, self.damaged = result, None, 4, False

    def forbidden(self, link: Link, result: list[int]) -> str:
        """The reason why a run keeps this table from coming into use; "" without one."""
        model = self.model
        moved = {place: (a, b) for place, (a, b) in enumerate(zip(model.in_use, result, strict=True)) if a != b}
        gains = moved.keys() <= {ROWS[name] for name, _ in LIVE}
        if model.armed and model.owner is not link:
            return "OWNER"
        if model.armed:
            first = model.at_arming
            near = all(first[place] <= 2 * b and b <= 2 * first[place] for place, (_, b) in moved.items())
            return "" if gains and near else "ARMED"
        return "" if model.run is None or (model.run != "LOCKSTEP" and gains) else "BUSY"

    @rule(link=links, verb=st.sampled_from(["SAVE", "SAVE", "LOAD", "DEFAULTS"]))
    def verb(self, link: Link, verb: str) -> None:
        model, there = self.model, self.model.link[link]
        cells = bytes(self.hosts.mcu.flash)
        reason = self.reason(self.with_nonce(link, "EXECUTE", verb))
        expected = "GREETING" if not there.greeted else "BUSY" if model.run else ""
        if verb == "LOAD" and expected == "" and self.saved is None:
            expected = "PARAMETERS" if self.damaged else "NOTHING_SAVED"
        assert reason == (expected if there.lets_in else "closed") or (verb == "LOAD" and reason == "PARAMETERS")
        assert (verb == "SAVE" and reason == "") or bytes(self.hosts.mcu.flash) == cells
        if reason in ("NOTHING_SAVED", "PARAMETERS"):
            model.staged = None  # its place was needed
        elif reason == "" and verb == "SAVE":
            self.saved, model.source, self.damaged = list(model.in_use), 1, False
        elif reason == "":
            model.in_use = list(self.saved if verb == "LOAD" and self.saved else DEFAULTS)
            model.staged, model.source, self.damaged = None, 1 if verb == "LOAD" else 0, False

    # ---- rules: power ----

    @rule(operation=st.integers(1, 400), way=st.integers(0, 3), row=st.sampled_from(VALUES))
    def save_and_cut_power(self, operation: int, way: int, row: tuple[str, int]) -> None:
        """Power fails at some operation of the flash: what was saved last is there, or what was to be saved."""
        self.connect(Link.UART)
        self.end(Link.UART)
        self.stage(Link.UART, row)
        self.commit(Link.UART, 0)
        self.hosts.wires.flash_cut, self.hosts.wires.flash_cut_way = operation, way
        number = self.hosts.protocol["CHALLENGE"].value("verb", "SAVE")
        said = self.ask(Link.UART, "CHALLENGE", number, 0, answer="NONCE")
        assert said is not None
        self.hosts.put(Link.UART, self.hosts.sealed(Link.UART, "EXECUTE", number, said[1]["nonce"]))
        self.hosts.pass_ms(3)
        self.hosts.wires.flash_cut = 0
        if self.hosts.mcu.state is State.RUNNING:
            self.saved, self.model.source, self.damaged = list(self.model.in_use), 1, False
            return
        self.restart((self.saved, list(self.model.in_use)))

    @rule()
    def power_cycle(self) -> None:
        self.hosts.mcu.power_off()
        self.restart((self.saved,))

    def restart(self, may_load: tuple[list[int] | None, ...]) -> None:
        """Start the board: it has loaded one of these (None: the factory's values), as IDENTITY says."""
        self.alive = False
        self.counted_us = self.hosts.now_us - SAFE_US  # nothing is armed that could be let go
        self.hosts.power_on()
        items: dict[int, int] = {}
        self.hosts.text(b"\rO\r")
        hello = self.hosts.sealed(Link.UART, "HELLO", self.hosts.protocol.version, self.hosts.protocol.dbc_hash)
        self.hosts.received[Link.UART].clear()
        self.hosts.put(Link.UART, hello)
        self.hosts.pass_ms(IDENTITY_MS)
        for name, said in self.hosts.received[Link.UART]:
            if name == "IDENTITY":
                items[said["item"]] = said["value"]
        identity = self.hosts.protocol["IDENTITY"]
        crc, source = items[identity.value("item", "PARAMETER_CRC")], items[identity.value("item", "PARAMETER_SOURCE")]
        loaded = [table for table in may_load if parameters.crc32(table or DEFAULTS) == crc]
        assert loaded, "what was loaded is nothing that was saved as a whole"
        self.saved = loaded[-1] if source == 1 else None
        assert (source == 1) == (loaded[-1] is not None) or None in loaded
        self.damaged = source in (2, 3)
        assert not self.damaged or None in may_load
        self.model = BoardModel(list(self.saved or DEFAULTS), source)
        self.model.link[Link.UART] = LinkModel(open=True, greeted=True, received_us=self.hosts.now_us)

    # ---- rules: runs and arming ----

    @rule(link=links, run=st.sampled_from(["LOCKSTEP", "REALTIME_INJECTED", "REALTIME_LIVE"]))
    def begin(self, link: Link, run: str) -> None:
        model = self.model
        said = self.with_nonce(link, "RUN_BEGIN", run)
        if self.reason(said) == "":
            assert said is not None
            number, tag = said[1]["detail"] & 0xFFFF, said[1]["detail"] >> 16 & 15
            assert number == self.hosts.protocol["RUN_BEGIN"].value("run", run)
            assert 1 <= tag <= 15 and (model.tag is None or tag == model.tag % 15 + 1)
            model.disarm(COMMAND)
            self.alive = False
            model.run, model.owner, model.tag, model.step = run, link, tag, 0

    @rule(link=links)
    def end(self, link: Link) -> None:
        if self.ask(link, "RUN_END", 0, 0):
            self.model.disarm(COMMAND)
            self.model.run = None

    @rule(link=links)
    def disarm(self, link: Link) -> None:
        assert self.reason(self.ask(link, "DISARM", 0, 0)) == ""
        self.model.disarm(COMMAND)

    @rule(link=links)
    def arm(self, link: Link) -> None:
        self.is_armed_by(link)

    def is_armed_by(self, link: Link) -> bool:
        """Refused with the reasons that the model has, or armed."""
        expected = self.model.blocked(link, self.damaged)
        said = self.with_nonce(link, "EXECUTE", "ARM")
        if said is None:
            return False
        if said[0] == "NACK":
            free = SENSORS_SAY | (SAMPLES if self.model.run == "REALTIME_INJECTED" else 0)
            assert self.reason(said) == "BLOCKED" and said[1]["detail"] & ~free == expected
            assert said[1]["detail"] & (expected | free), "refused for no reason"
            return False
        assert expected == 0
        self.model.armed, self.model.cause, self.alive = True, 0, True
        self.model.at_arming = list(self.model.in_use)
        return True

    def connect(self, link: Link) -> None:
        if link is Link.UART:
            self.text_command("O")
        self.hello(link, 0, 0)

    @rule(link=links)
    def connect_and_arm(self, link: Link) -> None:
        """A host that does everything right, on a board at rest, is armed within seconds."""
        self.connect(link)
        if self.damaged:
            self.end(link)
            self.verb(link, "DEFAULTS")
        self.begin(link, "REALTIME_LIVE")
        for _ in range(READY_MS // 50):
            if self.is_armed_by(link):
                break
            self.pass_ms(50)
        assert self.model.armed

    @rule()
    def let_go(self) -> None:
        self.alive = False

    @rule(link=links, count=st.integers(1, 60))
    def replay_keep_alives(self, link: Link, count: int) -> None:
        """Values that were answered before, and made up ones, hold nothing, over either link."""
        self.alive = False
        for at in range(count):
            words = self.values[-1 - at % 2] if len(self.values) >= 2 else (1, 0x12345678)
            self.hosts.put(link, self.hosts.sealed(link, "KEEPALIVE", *words))
            if self.model.link[link].lets_in:
                self.model.link[link].received_us = self.hosts.now_us
            self.pass_ms(1)

    @rule(link=links, count=st.integers(1, 6))
    def samples(self, link: Link, count: int) -> None:
        model = self.model
        for _ in range(count):
            self.hosts.received[link].clear()
            step = model.step
            frame = self.hosts.sealed(link, "SAMPLE_A", 1676, 2048, 3041, flags=step >> 4 & 3, counter=step & 15)
            self.hosts.put(link, frame)
            self.pass_ms(2)
            nacks = [said for name, said in self.hosts.received[link] if name == "NACK" and said["request"] == frame[0]]
            reasons = [self.hosts.protocol["NACK"].choice("reason", said["reason"]) for said in nacks]
            if not model.link[link].lets_in:
                assert reasons == []
                continue
            model.link[link].received_us = self.hosts.now_us
            if not model.link[link].greeted:
                assert reasons == ["GREETING"]
            elif model.run in (None, "REALTIME_LIVE"):
                assert reasons == ["NO_RUN"]
            elif model.owner is not link:
                assert reasons == ["OWNER"]
            elif model.run == "LOCKSTEP":
                assert reasons == []
                steps = [said["step"] for name, said in self.hosts.received[link] if name == "STEP"]
                assert steps == [step & 0xFFFF]
                model.step += 1
            else:
                assert reasons in ([], ["QUEUE_FULL"])
                model.step += 1

    @rule(link=links)
    def mismatching_host_tries_everything(self, link: Link) -> None:
        """But for stopping it, which any host may."""
        if link is Link.UART:
            self.text_command("O")
        self.hello(link, 1, 0)
        cells, in_use = bytes(self.hosts.mcu.flash), list(self.model.in_use)
        self.stage(link, ("period_us", 2500))
        self.commit(link, 0)
        for verb in ("SAVE", "LOAD", "DEFAULTS"):
            self.verb(link, verb)
        for run in ("LOCKSTEP", "REALTIME_INJECTED", "REALTIME_LIVE"):
            self.begin(link, run)
        assert not self.is_armed_by(link)
        self.samples(link, 1)
        said = self.ask(link, "SETPOINT", 0, 1 << 28, flags=self.model.tag or 1)
        assert self.reason(said) == "GREETING"
        assert self.model.in_use == in_use and bytes(self.hosts.mcu.flash) == cells
        self.read_back(link)

    # ---- rules: the lines ----

    @rule(
        lines=st.lists(st.binary(min_size=1, max_size=40), min_size=1, max_size=5),
        repeated=st.sampled_from([1, 1, 300]),
    )
    def garbage(self, lines: list[bytes], repeated: int) -> None:
        """Lines that no host says: BEL each, and the next request is answered as ever."""
        spoilt = [b"\xfe" + bytes(byte for byte in line if byte not in b"\r\a") + b"\r" for line in lines] * repeated
        refused = self.hosts.refused
        self.hosts.text(b"".join(spoilt))
        self.pass_ms(3 + sum(map(len, spoilt)) // 500)
        assert self.hosts.refused == refused + len(spoilt)

    @rule(link=links, bit=st.integers(0, 63))
    def damaged_request(self, link: Link, bit: int) -> None:
        identifier, data = self.hosts.sealed(link, "DISARM", 0, 0)
        broken = (int.from_bytes(data, "little") ^ 1 << bit).to_bytes(8, "little")
        self.hosts.put(link, (identifier, broken))
        self.pass_ms(2)

    @rule(ms=st.sampled_from([1, 7, 60, 300, 2200]))
    def time_passes(self, ms: int) -> None:
        self.pass_ms(ms)

    @initialize(clock_us=st.sampled_from([0, (1 << 32) - 1_500_000]))
    def start(self, clock_us: int) -> None:
        """The clock wraps after 71.6 min: in some sequences soon."""
        Hosts.sequences += 1
        self.hosts.mcu.power_off()
        self.hosts.mcu.set_clock_us(clock_us)
        self.restart((None,))
        self.text_command("C")


def test_two_hosts_against_the_model() -> None:
    run_state_machine_as_test(
        Hosts,
        settings=settings(
            max_examples=campaign(12, 60),
            stateful_step_count=60 if LONG else 30,
            derandomize=not LONG,
            deadline=None,
            database=None,
            phases=(Phase.generate, Phase.shrink),
            suppress_health_check=list(HealthCheck),
        ),
    )
    assert Hosts.sequences >= campaign(12, 60)
