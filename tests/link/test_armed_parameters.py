"""Gains of an armed run: from its owner, at most a factor of two in all, without a jump, bit by bit as the model."""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import partial
from itertools import pairwise

import pytest

from plumb.contract import run_fixed
from plumb.errors import LinkError, UsageError
from plumb.link import parameter_table
from plumb.link.identity import NackError
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.spec import parameters
from plumb.spec.parameter_file import by_name
from plumb.spec.protocol import Frame
from plumb.systems import shipped_tunings
from plumb.tuning import quantities
from support.native_board import NewBoard, UartBoard
from support.sessions import STEER

ROWS = parameters.table()
LIVE = [row for row in ROWS if row.live]
PULSES = ("pulse_halfus_0", "pulse_halfus_1")
SETTLED = 40
"""Steps after which the command has followed the setpoint."""


class ArmedRun:
    """An armed run in real time with a setpoint, whose every step and every change of parameters is recorded."""

    def __init__(self, board: UartBoard, link: str = "serial", period_us: int = 2500) -> None:
        self.board = board
        self.session = Session.over(board.can_bus()) if link == "can" else Session(PlumbBus(board))
        self.session.connect()
        parameter_table.commit(self.session, {**shipped_tunings.table_of("quad", None), "period_us": period_us})
        self.table = by_name(parameter_table.read_table(self.session))
        self.capture = Capture(self.session)
        self.used: list[tuple[int, int]] = []
        self.tables = {parameters.crc32(list(self.table.values())): self.table}
        self.session.begin("REALTIME_LIVE", frames=["RAW_A", "RAW_B"])
        self.session.listener = self._receive
        self.arm()
        self.capture.set_setpoint(STEER // 8)  # far from full command
        self.steps(SETTLED)

    def _receive(self, frames: list[Frame]) -> None:
        message = self.session.protocol["PARAM_USED"]
        self.capture.feed(frames)
        self.used += [
            (said["step"], said["crc"])
            for identifier, data in frames
            if identifier == message.identifier and (said := message.decode(data))
        ]

    def arm(self) -> None:
        """As soon as the board is ready."""
        for _ in range(100):
            try:
                self.session.arm()
                return
            except NackError:
                self.run_for(0.02)
        raise AssertionError("the board is never ready")

    def run_for(self, seconds: float) -> None:
        end_s = self.session.clock() + seconds
        while self.session.clock() < end_s:
            self.session.receive(0.005)

    def steps(self, count: int) -> None:
        self.capture.collect(self.capture.steps + count)

    def change(self, **factors: float) -> int:
        """Commit the gains of pid times these factors; the first step with them."""
        wanted = {name: round(self.table[name] * factor) for name, factor in factors.items()}
        return self.commit({**self.table, **wanted})

    def commit(self, table: dict[str, int]) -> int:
        parameter_table.commit(self.session, table, self.table)
        self.table = table
        self.tables[parameters.crc32(list(table.values()))] = table
        self.steps(2)
        return self.used[-1][0]

    def words(self, *, retuned: bool = True) -> list[dict[str, int]]:
        """Of the model on the recorded counts and changes. retuned: with the changes; else as if there were none."""
        at = {step: self.tables[crc] for step, crc in self.used if retuned}
        first = next(iter(self.tables.values()))
        model, found = run_fixed.Controller(quantities.control_of(first)), []
        setpoints = self.capture.setpoints.of_steps(self.capture.steps)
        for step in range(self.capture.steps - 2):
            if step in at:
                model.retune(quantities.control_of(at[step]))
            found.append(model.step(self.capture.raw[step], int(setpoints[step])))
            found[-1]["digest"] = model.digest()
        return found

    def verified(self) -> list[dict[str, int]]:
        """The words of every step, once all have been found equal to the board's."""
        words = self.words()
        assert self.board.armed
        assert [word["digest"] for word in words] == [self.capture.digest[step] for step in range(len(words))]
        return words


def direct(word: dict[str, int], gains: dict[str, int]) -> int:
    """What the demand is more than the integral: the P and D terms."""
    turned = word["error_turn_q32"] * gains["pid.kp_q22"] >> 32
    return turned - (word["rate_filtered_turnps_q27"] * gains["pid.kd_q27"] >> 32)


def refusal(request: Callable[[], object]) -> tuple[str, int]:
    with pytest.raises(NackError) as refused:
        request()
    return refused.value.reason, refused.value.detail


def place(name: str) -> int:
    return next(i for i, row in enumerate(ROWS) if row.name == name)


@pytest.mark.parametrize("link", ["serial", "can"])
def test_gains_of_an_armed_run_change_without_a_jump(new_board: NewBoard, link: str) -> None:
    run = ArmedRun(new_board(), link)
    old = run.table
    at = run.change(**{"pid.kp_q22": 1.9, "pid.ki_dt_q22": 0.55, "pid.kd_q27": 1.4})
    new = run.table
    run.steps(SETTLED)
    again = run.change(**{"pid.kp_q22": 0.5, "pid.ki_dt_q22": 2.0})
    run.steps(SETTLED)
    words, still = run.verified(), run.words(retuned=False)
    assert SETTLED <= at < again < len(words) - SETTLED // 2
    demands, without = ([word["command_q22"] + word["excess_q22"] for word in run] for run in (words, still))
    moved = {which: direct(words[at], gains) - direct(words[at - 1], gains) for which, gains in ((0, old), (1, new))}
    assert abs(demands[at] - without[at] - (moved[1] - moved[0])) <= 2, "but for what error and rate have changed"
    assert abs(direct(words[at], new) - direct(words[at], old)) > 10_000, "it would have jumped"
    assert demands[-1] != without[-1], "the new gains act"
    slew, low, high = (run.table[name] for name in ("pid.slew_q22", "esc.min_halfus", "esc.max_halfus"))
    commands = [word["command_q22"] for word in words]
    assert all(abs(b - a) <= slew for a, b in pairwise(commands))
    assert all(low <= word[pulse] <= high for word in words for pulse in PULSES)
    run.session.close()


REFUSED: list[tuple[str, dict[str, float], str]] = [
    ("not a gain", {"esc.max_halfus": 0.99}, "esc.max_halfus"),
    ("a gain and another", {"pid.kp_q22": 1.1, "pid.slew_q22": 0.5}, "pid.slew_q22"),
    ("a word of the link", {"arm_hold_ms": 2.0}, "arm_hold_ms"),
    ("more than twice", {"pid.kp_q22": 2.01}, "pid.kp_q22"),
    ("less than half", {"pid.kd_q27": 0.49}, "pid.kd_q27"),
    ("another sign", {"pid.kp_q22": -1.0}, "pid.kp_q22"),
    ("to zero", {"pid.ki_dt_q22": 0.0}, "pid.ki_dt_q22"),
    ("of another system's controller", {"speed.ki_dt_q22": 2.1}, "speed.ki_dt_q22"),
]


def test_what_an_armed_board_does_not_take_changes_nothing(new_board: NewBoard) -> None:
    run = ArmedRun(new_board())
    session = run.session
    for what, factors, word in REFUSED:
        table = {**run.table, **{name: round(run.table[name] * factor) for name, factor in factors.items()}}
        words = list(table.values())
        for name in factors:
            word_now = table[name] & 0xFFFFFFFF
            session.request("PARAM_SET", place(name), word_now, answer="PARAM_STAGED", first=place(name))
        commit = partial(session.request, "PARAM_COMMIT", len(words), parameters.crc32(words))
        assert refusal(commit) == ("ARMED", place(word)), what
        session.connect()  # which forgets what is staged
        assert session.read_parameters() == list(run.table.values()), what
    session.request("PARAM_SET", place("pid.kp_q22"), run.table["pid.kp_q22"] + 1, answer="PARAM_STAGED")
    stale = parameters.crc32(list(run.table.values()))
    assert refusal(lambda: session.request("PARAM_COMMIT", len(ROWS), stale)) == ("CRC", 0)
    run.steps(SETTLED)
    run.verified()
    assert not run.used
    session.close()


def test_only_the_owner_changes_an_armed_run(new_board: NewBoard) -> None:
    run = ArmedRun(new_board())
    with Session.over(run.board.can_bus()) as other:
        other.connect()
        run.steps(5)
        table = {**run.table, "pid.kp_q22": run.table["pid.kp_q22"] + 1000}
        with pytest.raises(LinkError, match="armed over its other link"):
            parameter_table.commit(other, table, run.table)
        run.steps(5)
        run.commit(table)
        run.verified()
    run.session.close()


def test_a_run_of_the_arm_switch_keeps_its_gains() -> None:
    board = UartBoard()
    session = Session.open(board)
    words = session.read_parameters()
    board.run_us(100_000)
    board.switch(True)
    board.run_us(2_000_000)
    assert board.armed
    words[place("pid.kp_q22")] += 5
    session.request("PARAM_SET", place("pid.kp_q22"), words[place("pid.kp_q22")], answer="PARAM_STAGED")
    crc = parameters.crc32(words)
    assert refusal(lambda: session.request("PARAM_COMMIT", len(words), crc)) == ("OWNER", 0)
    assert board.armed


def test_zero_stays_zero_and_the_last_bit_of_twice_and_half_counts() -> None:
    board = UartBoard()
    run = ArmedRun(board)
    run.session.disarm()
    edge = {**run.table, "pid.kp_q22": -1000001, "pid.ki_dt_q22": 0, "pid.kd_q27": 4}
    run.commit(edge)
    run.session.set_setpoint(0)
    run.arm()
    for values, word in (
        ({"pid.kp_q22": -2000003}, "pid.kp_q22"),
        ({"pid.kp_q22": -500000}, "pid.kp_q22"),
        ({"pid.ki_dt_q22": 1}, "pid.ki_dt_q22"),
        ({"pid.kd_q27": 9}, "pid.kd_q27"),
        ({"pid.kd_q27": 1}, "pid.kd_q27"),
    ):
        assert parameters.refused_while_armed(edge, {**edge, **values}) == [ROWS[place(word)]]
        with pytest.raises(UsageError, match="armed board"):
            parameter_table.commit(run.session, {**edge, **values}, edge)
        run.session.connect()
    for values in ({"pid.kp_q22": -2000002}, {"pid.kp_q22": -1000001}, {"pid.kd_q27": 8}, {"pid.kd_q27": 4}):
        run.commit({**run.table, **values})
    assert len(run.used) == 5 and board.armed
    run.session.close()


def test_six_commits_in_a_row_stay_within_twice_the_gain_at_arming(new_board: NewBoard) -> None:
    """Up by less than twice each; back to the gain at arming; and a new arming counts anew."""
    run = ArmedRun(new_board())
    run.session.set_setpoint(0)
    first = run.table["pid.kp_q22"]
    taken = []
    for _ in range(6):
        try:
            run.commit({**run.table, "pid.kp_q22": round(run.table["pid.kp_q22"] * 1.6)})
        except UsageError as refused:
            assert f"is more than twice {quantity(run.table, first)}, its value at arming" in str(refused)
        taken.append(run.table["pid.kp_q22"])
    assert taken == [round(1.6 * first)] * 6 and run.board.armed
    run.commit({**run.table, "pid.kp_q22": first})
    run.session.disarm()
    run.commit({**run.table, "pid.kp_q22": 3 * first})
    run.arm()
    run.commit({**run.table, "pid.kp_q22": 6 * first})
    run.session.close()


def quantity(table: dict[str, int], kp: int) -> str:
    """The gain in the unit of `plumb params`, as a sentence has it."""
    return f"{quantities.values_of({**table, 'pid.kp_q22': kp})['pid.kp_per_deg']:g}"


def test_a_thousand_random_commits_leave_no_range_and_no_doubt() -> None:
    rng = random.Random(13)
    run = ArmedRun(UartBoard(), period_us=1000)
    taken, refused, at_arming = 0, 0, dict(run.table)
    for _ in range(1000):
        table = dict(run.table)
        for row in rng.sample(LIVE, rng.randint(1, 3)):
            value = round(table[row.name] * rng.choice((0.4, 0.5, 0.6, 1.0, 1.5, 1.99, 2.0, 2.2, -1.0)))
            table[row.name] = min(max(value, row.min), row.max)
        if rng.random() < 0.1:
            table["esc.span_halfus"] += 1
        allowed = not parameters.refused_while_armed(run.table, table, at_arming)
        try:
            parameter_table.commit(run.session, table, run.table)
        except UsageError:
            assert not allowed
            refused += 1
            run.session.connect()
            continue
        assert allowed
        run.table = table
        run.tables[parameters.crc32(list(table.values()))] = table
        taken += 1
    run.steps(5)
    words = run.verified()
    assert taken > 300 and refused > 100 and len(run.used) == taken
    slew, low, high = (run.table[name] for name in ("pid.slew_q22", "esc.min_halfus", "esc.max_halfus"))
    commands = [word["command_q22"] for word in words]
    assert all(abs(b - a) <= slew for a, b in pairwise(commands))
    assert all(low <= word[pulse] <= high for word in words for pulse in PULSES)
    run.session.close()


def test_a_silent_host_that_only_commits_loses_the_board_in_50_ms(new_board: NewBoard) -> None:
    run = ArmedRun(new_board())
    board, session = run.board, run.session
    words = list(run.table.values())
    kp = place("pid.kp_q22")
    frames = PlumbBus(board)
    begin_us = board.time_us
    while board.armed and board.time_us - begin_us < 100_000:
        words[kp] += 1
        sent = [session.frame("PARAM_SET", kp, words[kp])]
        frames.write_frames([*sent, session.frame("PARAM_COMMIT", len(words), parameters.crc32(words))])
        board.run_us(1000)
        board.received()
    assert not board.armed and board.time_us - begin_us <= 50_000
    board.run_us(2000)
    assert board.pulses == (run.table["esc.neutral_halfus"],) * 2


@pytest.mark.parametrize("link", ["serial", "can"])
def test_a_storm_of_commits_makes_no_step_late(new_board: NewBoard, link: str) -> None:
    board = new_board()
    run = ArmedRun(board, link, period_us=500)
    run.session.select([])
    session = run.session
    words, kp = list(run.table.values()), place("pid.kp_q22")
    begin_us, begin = board.time_us, board.steps
    while board.time_us - begin_us < 30_000:
        run.run_for(0.002)
        words[kp] += 1
        staged = session.frame("PARAM_SET", kp, words[kp])
        session.send([staged, *(session.frame("PARAM_COMMIT", len(words), parameters.crc32(words)) for _ in range(3))])
    took, steps = board.time_us - begin_us, board.steps - begin
    run.run_for(0.02)
    assert board.armed and session.telemetry["STATUS"]["faults"] == 0
    assert abs(steps - took / 500) <= 2 and session.read_parameters()[kp] == words[kp]
    session.close()
