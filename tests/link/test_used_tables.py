"""The table that a run uses from a step on is known from the frames that were seen, and only when its CRC is right."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from plumb.link import parameter_table, used_tables
from plumb.link.realtime import Capture
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.link.used_tables import ASK_EVERY_S, ASKED_MOST, NEXT, TABLE_MESSAGES, TableEvent, TableState, UsedTables
from plumb.proof.shadow import Shadow
from plumb.spec import parameters
from plumb.spec.parameter_file import by_name
from plumb.spec.protocol import Frame, protocol
from plumb.systems import shipped_tunings
from plumb.tuning import quantities
from support.native_board import UartBoard

MESSAGES = protocol()
DEFAULT = [row.default & 0xFFFFFFFF for row in parameters.table()]
KP = next(index for index, row in enumerate(parameters.table()) if row.name == "pid.kp_q22")
NEW = [*DEFAULT[:KP], 4711, *DEFAULT[KP + 1 :]]
QUAD = {**shipped_tunings.table_of("quad", None), "period_us": 2500}


def said(name: str, *words: int) -> tuple[int, bytes]:
    return MESSAGES[name].identifier, MESSAGES[name].pack(0, 0, *words)


def used(step: int, words: list[int] = NEW) -> tuple[int, bytes]:
    return said("PARAM_USED", step & 0xFFFF, parameters.crc32(words))


def read(words: list[int]) -> list[tuple[int, bytes]]:
    return [said("PARAM_VALUE", index, word) for index, word in enumerate(words)]


def fed(frames: list[tuple[int, bytes]], words: list[int] | None = DEFAULT, next_step: int = 100) -> UsedTables:
    tables = UsedTables(MESSAGES, words)
    for identifier, data in frames:
        tables.feed(identifier, data, next_step)
    return tables


STAGED = said("PARAM_STAGED", KP, 4711)
COMMITTED = said("ACK", MESSAGES["PARAM_COMMIT"].identifier, parameters.crc32(NEW))


@pytest.mark.parametrize(
    ("frames", "known"),
    [
        ([STAGED, used(100), COMMITTED], True),
        ([said("PARAM_SET", KP, 4711), used(100)], True),
        ([used(100)], False),
        ([used(100), *read(NEW)], True),
        ([used(100), *read(NEW)[KP:]], True),
        ([used(100), *read(NEW)[KP + 1 :]], False),
        ([*read(NEW), used(100)], False),
        ([used(100), *read(DEFAULT)], False),
        ([STAGED, said("IDENTITY", 0, 0), used(100)], False),
        ([STAGED, said("HELLO", 1, 0), used(100)], False),
        ([said("PARAM_STAGED", KP, 4712), used(100), *read(NEW)], True),
        ([STAGED, said("PARAM_STAGED", KP + 1, 5), used(100), *read(NEW)], True),
    ],
)
def test_a_table_is_known_when_its_crc_is_the_one_of_the_announcement(
    frames: list[tuple[int, bytes]], known: bool
) -> None:
    (change,) = fed(frames).changes
    assert change.step == 100 and change.words == (tuple(NEW) if known else None)
    before = quantities.control_of(by_name(DEFAULT))
    params = change.params(before)
    assert (params is not None) == known and (params is None or params["pid.kp_q22"] == 4711)


def test_a_table_is_known_without_the_first_one_when_all_of_it_was_seen() -> None:
    (change,) = fed([used(100), *read(NEW)], words=None).changes
    assert change.words == tuple(NEW)
    assert fed([STAGED, used(100)], words=None).changes[0].words is None


def test_steps_are_unwrapped() -> None:
    (change,) = fed([STAGED, used(70_001)], next_step=69_999).changes
    assert change.step == 70_001


def test_a_commit_whose_announcement_was_lost_is_known_to_have_been_one() -> None:
    (change,) = fed([STAGED, COMMITTED]).changes
    assert not change.announced and change.params(quantities.control_of(by_name(DEFAULT))) is None
    assert "the frame with the step is missing" in change.why_unknown
    assert not fed([said("ACK", MESSAGES["PARAM_COMMIT"].identifier, parameters.crc32(DEFAULT))]).changes


def test_a_new_run_begins_with_the_last_table() -> None:
    begun = said("ACK", MESSAGES["RUN_BEGIN"].identifier, 3)
    tables = fed([STAGED, used(100), begun, said("PARAM_STAGED", KP, DEFAULT[KP]), used(5, DEFAULT)], next_step=5)
    assert [(change.step, change.words) for change in tables.changes] == [(5, tuple(DEFAULT))]


def test_random_frames_never_make_a_table_that_the_board_did_not_announce() -> None:
    """Whatever order, the words of a known change have its CRC-32."""
    import random

    rng = random.Random(13)
    pool = [STAGED, used(100), COMMITTED, *read(NEW), *read(DEFAULT), said("PARAM_STAGED", KP, 9), said("HELLO", 1, 0)]
    found = 0
    for _ in range(400):
        tables = fed([rng.choice(pool) for _ in range(40)] + read(rng.choice([NEW, DEFAULT])))
        for change in tables.changes:
            assert change.words is None or parameters.crc32(change.words) == change.crc32
            found += change.words is not None
    assert found > 30


def test_the_board_is_asked_a_few_times_and_not_more() -> None:
    tables = fed([used(100)])
    assert not tables.lost(tables.changes[0])
    asked = [second for second in range(0, 60) if tables.ask(0.5 * second)]
    assert asked == [0, 2, 4, 6, 8]
    assert tables.lost(tables.changes[0])


# ---- every way from one state to another ----

OTHER = [*DEFAULT[:KP], 1234, *DEFAULT[KP + 1 :]]
BEGUN = said("ACK", MESSAGES["RUN_BEGIN"].identifier, 3)


def asked_until_given_up(tables: UsedTables) -> None:
    for request in range(ASKED_MOST + 1):
        tables.ask(ASK_EVERY_S * request)


def in_state(state: TableState) -> UsedTables:
    """A follower that has come into that state by frames and requests alone."""
    tables = fed(
        [] if state in (TableState.UNREAD, TableState.KNOWN) else [used(100)],
        words=None if state is TableState.UNREAD else DEFAULT,
    )
    if state is TableState.LOST:
        asked_until_given_up(tables)
    assert tables.state is state
    return tables


def happen(tables: UsedTables, event: TableEvent) -> None:
    if event is TableEvent.GIVEN_UP:
        asked_until_given_up(tables)
        return
    frames = {TableEvent.FOUND: read(NEW), TableEvent.CHANGED: [used(120, OTHER)], TableEvent.BEGUN: [BEGUN]}
    for identifier, data in frames[event]:
        tables.feed(identifier, data, 120)


@pytest.mark.parametrize(("before", "event"), NEXT)
def test_every_transition_of_the_table_happens(before: TableState, event: TableEvent) -> None:
    tables = in_state(before)
    happen(tables, event)
    assert tables.state is NEXT[before, event]
    known = tables.state is TableState.KNOWN
    assert known == (event is TableEvent.FOUND or (before is TableState.KNOWN and event is TableEvent.BEGUN))
    if tables.changes:
        assert (tables.changes[-1].words is not None) == known
        assert tables.lost(tables.changes[-1]) == (tables.state is TableState.LOST)
    if known or tables.state is TableState.UNREAD:  # a staged word makes the next table only of one that is known
        base = NEW if event is TableEvent.FOUND else DEFAULT
        tables.feed(*said("PARAM_STAGED", KP, 99), 130)
        tables.feed(*used(130, [*base[:KP], 99, *base[KP + 1 :]]), 130)
        assert tables.state is (TableState.KNOWN if known else TableState.PENDING)


@pytest.mark.parametrize("state", TableState)
def test_what_is_no_event_of_a_state_leaves_it(state: TableState) -> None:
    for event in TableEvent:
        if (state, event) not in NEXT:
            tables = in_state(state)
            happen(tables, event)
            assert tables.state is state


def test_staged_and_read_words_are_kept_until_a_table_is_known() -> None:
    tables = fed([STAGED, *read(NEW)[:2]])
    assert (tables.seen.staged, tables.seen.read) == ({KP: 4711}, dict(enumerate(NEW[:2])))
    tables.feed(*used(100), 100)
    assert (tables.seen.staged, tables.seen.read, tables.state) == ({}, {}, TableState.KNOWN)


def test_a_table_that_was_given_up_counts_when_another_host_reads_it() -> None:
    tables = in_state(TableState.LOST)
    happen(tables, TableEvent.FOUND)
    assert tables.changes[0].words == tuple(NEW) and not tables.lost(tables.changes[0])


# ---- a board whose parameters another host changes ----


class Watched:
    """A run of the board with a shadow. hidden: messages that this session does not see, as those of another link."""

    def __init__(self, session: Session) -> None:
        self.session, self.hidden = session, set[str]()
        parameter_table.commit(session, QUAD)
        self.capture, self.shadow = Capture(session), Shadow(quantities.control_of(QUAD))
        session.begin("REALTIME_LIVE", frames=["RAW_A", "RAW_B"])
        session.listener = self.feed

    def feed(self, frames: list[Frame]) -> None:
        hidden = {MESSAGES[name].identifier for name in self.hidden}
        self.capture.feed([frame for frame in frames if frame[0] not in hidden])
        self.shadow.follow(self.capture, 0)

    def change(self, kp_per_deg: float) -> None:
        """Commit another gain; what is said meanwhile is not seen."""
        self.hidden = set(TABLE_MESSAGES) - {"PARAM_USED"}
        parameter_table.commit(self.session, quantities.changed(QUAD, {"pid.kp_per_deg": kp_per_deg}))
        self.hidden = set()


@pytest.fixture
def watched() -> Iterator[Watched]:
    with Session(PlumbBus(UartBoard())) as session:
        session.connect()
        yield Watched(session)


def collect(watched: Watched, more: int) -> None:
    watched.capture.collect(watched.capture.steps + more)


def test_a_table_that_another_host_wrote_is_read_from_the_board(watched: Watched) -> None:
    collect(watched, 20)
    watched.change(0.02)
    at = watched.capture.parameters_step
    collect(watched, 200)
    shadow = watched.shadow
    assert at is not None and [change.step for change in shadow.changes] == [at]
    assert (shadow.verdict, shadow.unverified_from) == ("pass", None) and shadow.steps > at + 150


def test_two_changes_of_another_host_in_a_row_leave_the_first_unverified(watched: Watched) -> None:
    collect(watched, 20)
    watched.change(0.02)
    at = watched.capture.parameters_step
    watched.change(0.03)
    collect(watched, 100)
    shadow = watched.shadow
    assert (shadow.verdict, shadow.unverified_from, shadow.divergence) == ("unverified", at, None)
    assert shadow.unverified_why.endswith("and no frame has the new ones")


def test_a_board_that_does_not_send_its_table_leaves_the_steps_unverified(
    watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(used_tables, "ASK_EVERY_S", 0.02)
    collect(watched, 20)
    watched.change(0.02)
    at = watched.capture.parameters_step
    watched.hidden = {"PARAM_VALUE"}
    collect(watched, 100)
    assert (watched.shadow.verdict, watched.shadow.unverified_from) == ("unverified", at)


def test_a_board_that_uses_another_table_than_it_says_is_found_out(watched: Watched) -> None:
    """Here the model has another gain than the board."""
    collect(watched, 20)
    watched.change(0.02)
    collect(watched, 20)
    (change,) = watched.shadow.changes
    wrong = {**change.params.values, "pid.kp_q22": change.params["pid.kp_q22"] ^ 1 << 20}
    watched.shadow._model.retune(type(change.params)(wrong))
    collect(watched, 200)
    assert watched.shadow.verdict == "fail"
