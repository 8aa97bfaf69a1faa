"""A recorded run is reproduced bit for bit, from a log and from other tools' files; what was lost is unverified."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from plumb import __main__ as front
from plumb import systems
from plumb.boards import open_board
from plumb.boards.contract import RawCounts, Setpoints, StepBoard
from plumb.boards.in_process import InProcessParts
from plumb.boards.native.board import NativeBoard as NativeCore
from plumb.errors import UnverifiedError, UsageError
from plumb.link.paced import PacedRun
from plumb.proof.runs import judge
from plumb.readers import log_replay, run_parts
from plumb.readers.log_file import FRAME, Frames, read_log
from plumb.readers.log_replay import Reproduction, chosen, open_log, reproduce, runs_of
from plumb.spec.protocol import protocol
from plumb.writers import log_writer
from plumb.writers.log_writer import LogWriter
from support.recordings import GAINS, recorded_run, rewritten, with_frames, with_json

ANOTHER = systems.with_part("replay")[-1]
"""A system that replays recordings, and that the logs are not of."""

STEER = 1 << 28


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_run(tmp_path_factory.mktemp("log") / "whole.plog", setpoint=STEER)


def on_native(path: Path, number: int | None = None) -> Reproduction:
    return reproduce(chosen(runs_of(open_log(path)), number), NativeCore(), "native", None, None)


def places(frames: Frames, name: str) -> list[int]:
    return np.flatnonzero(frames["can_id"] == protocol()[name].identifier).tolist()


def without(name: str, *numbers: int) -> Callable[[Frames], Frames]:
    """Without those of the frames of a message, by their order."""
    return lambda frames: np.delete(frames, [places(frames, name)[number] for number in numbers])


def sealed_again(frames: Frames, place: int, data: bytes) -> None:
    from plumb.spec.protocol import crc8

    body = bytes((crc8(int(frames["can_id"][place]), data), *data[1:]))
    frames["data"][place] = np.frombuffer(body, np.uint8)


def test_a_log_is_reproduced_in_every_bit(whole: Path) -> None:
    done = on_native(whole)
    recorded = done.recorded.run
    assert done.verdict == "pass" and done.compared == recorded.steps > 20 and done.unverified_from is None
    assert {0, STEER} == set(recorded.setpoint.tolist()) and len(set(recorded.digest.tolist())) == recorded.steps
    assert done.statement().text == f"every one of the {recorded.steps} recorded digests is reproduced"


@pytest.mark.parametrize("suffix", ["blf", "asc", "log", "trc", "mf4"])
def test_files_of_other_tools_are_reproduced_too(
    whole: Path, tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"run.{suffix}"
    assert front.main(["export", str(whole), str(path)]) == 0
    capsys.readouterr()
    assert front.main(["replay", str(path), "--board", "native", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["verdict"] == "pass" and said["bit_exact"] is True
    assert said["recorded"]["compared"] == said["steps"] == on_native(whole).compared
    ours, theirs = read_log(whole).frames, open_log(path).frames
    for field in ("can_id", "length", "data"):
        assert np.array_equal(ours[field], theirs[field])
    apart_us = np.asarray(ours["time_us"], np.int64) - np.asarray(theirs["time_us"], np.int64)
    assert np.abs(np.diff(apart_us)).max() <= 100  # of .trc 0.1 ms, rounded


def test_frames_without_parameters_take_them_from_a_file(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from plumb.spec import parameter_file, parameters

    def unread(frames: Frames) -> Frames:
        return np.delete(frames, places(frames, "PARAM_VALUE"))

    bare = with_frames(whole, tmp_path / "bare.plog", unread)
    bare = rewritten(bare, tmp_path / "none.plog", lambda kind, payload: None if kind == "PARM" else payload)
    command = ["replay", str(bare), "--board", "native"]
    assert front.main(command) == 2
    assert "none.plog holds no parameters of that run" in capsys.readouterr().err
    table = tmp_path / "table.toml"
    table.write_text(parameter_file.text_of([row.default for row in parameters.table()]))
    assert front.main([*command, "--params", str(table)]) == 0


def test_lost_counts_leave_the_steps_from_there_on_unverified(whole: Path, tmp_path: Path) -> None:
    done = on_native(with_frames(whole, tmp_path / "lost.plog", without("RAW_A", 9)))
    assert done.verdict == "unverified" and done.unverified_from == 9 == done.compared
    assert done.statement().text == (
        "9 recorded digests are reproduced; unverified from step 9 on: the raw counts of step 9 did not arrive"
    )


def test_a_lost_digest_leaves_its_own_step_unverified(whole: Path, tmp_path: Path) -> None:
    done = on_native(with_frames(whole, tmp_path / "lost.plog", without("STEP", 9)))
    assert done.verdict == "unverified" and done.unverified_from == 9
    assert done.compared == done.recorded.run.steps - 1 and not done.differ


def test_the_first_steps_frames_may_be_the_lost_ones(whole: Path, tmp_path: Path) -> None:
    done = on_native(with_frames(whole, tmp_path / "lost.plog", without("STEP", 0)))
    assert done.recorded.run.first == 0 and done.unverified_from == 0 and done.compared == done.recorded.known - 1


def test_a_lost_setpoint_leaves_the_steps_after_it_unverified(whole: Path, tmp_path: Path) -> None:
    """The report of the only setpoint is gone: nothing else shows that there was one."""
    done = on_native(with_frames(whole, tmp_path / "lost.plog", without("SETPOINT_USED", 0)))
    assert done.verdict == "fail"  # no counter shows a loss: every frame that followed is there
    both = with_frames(whole, tmp_path / "both.plog", without("SETPOINT_USED", 0))
    done = on_native(with_frames(both, tmp_path / "more.plog", without("TIME", 2)))
    assert done.verdict == "unverified" and "perhaps a setpoint" in done.statement().text


def test_an_output_that_differs_is_named(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def wrong(frames: Frames) -> Frames:
        """A board that computed another tilt in step 12: digest and signal of this step are its own."""
        for name, byte in (("STEP", 7), ("QUAD_ANGLE", 4)):
            place = places(frames, name)[12]
            data = bytearray(frames["data"][place].tobytes())
            data[byte] ^= 1
            sealed_again(frames, place, bytes(data))
        return frames

    path = with_frames(whole, tmp_path / "wrong.plog", wrong)
    assert front.main(["replay", str(path), "--board", "native", "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["verdict"] == "fail" and said["bit_exact"] is False and said["recorded"]["mismatches"] == 1
    first = said["recorded"]["first_divergence"]
    assert (first["step"], first["signal"]) == (12, "tilt") and first["expected"] ^ first["actual"] == 1


def test_other_parameters_than_those_of_the_run_are_found_out(whole: Path, tmp_path: Path) -> None:
    def other(head: dict[str, object]) -> None:
        values = head["values"]
        assert isinstance(values, dict) and "pid.kp_q22" in values
        values["pid.kp_q22"] = 77

    changed = with_json("PARM", other)
    bare = with_frames(whole, tmp_path / "bare.plog", lambda frames: np.delete(frames, places(frames, "PARAM_VALUE")))
    assert on_native(bare).verdict == "pass"
    assert on_native(rewritten(bare, tmp_path / "other.plog", changed)).verdict == "fail"


def test_a_damaged_frame_is_a_lost_one(whole: Path, tmp_path: Path) -> None:
    """Its CRC-8 is wrong: it does not count as what the board said."""

    def spoilt(frames: Frames) -> Frames:
        frames["data"][places(frames, "RAW_A")[9], 4] ^= 1
        return frames

    done = on_native(with_frames(whole, tmp_path / "spoilt.plog", spoilt))
    assert done.verdict == "unverified" and done.unverified_from == 9


def test_steps_after_a_change_of_parameters_are_unverified(whole: Path, tmp_path: Path) -> None:
    """Of a parameter that the step reads; another's change, or the same value again, is none."""
    log = read_log(whole)
    table, middle = log.parameter_sets[0].values, places(log.frames, "STEP")[12]
    for name, more, verdict in (
        ("pid.kp_q22", 1, "unverified"),
        ("pid.kp_q22", 0, "pass"),
        ("esc_period_us", 1, "pass"),
    ):
        path = tmp_path / f"{name}{more}.plog"
        with LogWriter(path, log.head) as writer:
            writer._blocks.append("PARM", json.dumps({"values": table}).encode())
            writer._blocks.append("FRMS", log.frames[:middle].tobytes())
            writer.parameters_changed({name: table[name] + more}, 12)
            writer._blocks.append("FRMS", log.frames[middle:].tobytes())
        done = on_native(path)
        assert done.verdict == verdict and done.compared == (12 if verdict == "unverified" else done.recorded.run.steps)
    assert "unverified" in (said := on_native(tmp_path / "pid.kp_q221.plog").statement().text)
    assert said.endswith("another table was committed about step 12, and the frame with the step is missing")


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The gains change twice in the middle of the run; the log has many blocks."""
    path = tmp_path_factory.mktemp("log") / "changed.plog"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(log_writer, "FLUSH_EVERY_S", 0.0)
        return recorded_run(path, setpoint=STEER, changes=[GAINS, {"pid.kp_q22": 77}])


def step_of_change(path: Path, number: int = 0) -> int:
    frames = read_log(path).frames
    data = frames["data"][places(frames, "PARAM_USED")[number]].tobytes()
    return protocol()["PARAM_USED"].decode(data)["step"]


@pytest.mark.parametrize("board", ["fixed", "native", "qemu"])
def test_a_run_is_reproduced_across_changes_of_its_parameters(changed: Path, board: str) -> None:
    (recorded,) = runs_of(open_log(changed))
    with open_board(board) as opened:
        done = reproduce(recorded, opened, board, None, None)
    assert [change.step for change in done.run.changes] == [step_of_change(changed, 0), step_of_change(changed, 1)]
    assert done.verdict == "pass" and done.compared == recorded.run.steps == recorded.known
    assert done.statement().text.endswith("recorded digests is reproduced, across 2 changes of parameters")
    stale = replace(recorded, changes=recorded.changes[:1])
    assert reproduce(stale, NativeCore(), board, None, None).divergence is not None, "the second change shows"


@pytest.mark.parametrize("link", ["serial", "can"])
def test_the_virtual_board_goes_across_the_changes_in_real_time(
    changed: Path, link: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (recorded,) = runs_of(open_log(changed))
    with open_board("virtual", link=link) as opened:
        done = reproduce(recorded, opened, "virtual", link, None)
        inner = PacedRun._for_step
        monkeypatch.setattr(PacedRun, "_for_step", lambda run, step: [] if step in (3, 4, 5) else inner(run, step))
        early = reproduce(recorded, opened, "virtual", link, None)
    assert (done.verdict, len(done.run.answer.digests), done.run.mismatches) == ("pass", recorded.run.steps, 0)
    first = step_of_change(changed)
    assert (early.verdict, early.unverified_from) == ("unverified", first), "lockstep verifies at least these"
    spoilt = replace(done.run.answer, digests=done.run.answer.digests ^ np.uint32(1))
    assert judge(opened, done.run.inputs, done.run.params, spoilt, done.run.changes).verdict == "fail"


def test_a_board_that_takes_no_parameters_in_lockstep_verifies_the_steps_before(changed: Path) -> None:
    (recorded,) = runs_of(open_log(changed))

    class Plain(StepBoard):
        """As a board behind a link."""

        name = "plain"
        words, controller = NativeCore.words, NativeCore.controller
        run_injected, words_of_step = NativeCore.run_injected, NativeCore.words_of_step
        stepper = NativeCore.stepper

    done, first = reproduce(recorded, Plain(), "plain", None, None), step_of_change(changed)
    assert (done.verdict, done.unverified_from, done.run.mismatches) == ("unverified", first, 0)
    assert done.compared == recorded.run.steps and not done.differ, "the model follows in any case"
    assert "plain takes no other parameters in lockstep" in done.statement().text


@pytest.mark.parametrize("board", ["fixed", "native", "qemu", "virtual"])
def test_a_run_that_is_too_long_for_memory_is_compared_in_parts(
    changed: Path, tmp_path: Path, board: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_replay, "DETAIL_STEPS", 5)
    monkeypatch.setattr(run_parts, "PART_STEPS", 8)
    first = step_of_change(changed)

    def wrong(frames: Frames) -> Frames:
        for name, byte in (("STEP", 7), ("QUAD_ANGLE", 4)):
            place = places(frames, name)[first + 3]
            data = bytearray(frames["data"][place].tobytes())
            data[byte] ^= 1
            sealed_again(frames, place, bytes(data))
        return frames

    with open_board(board) as opened:
        done = reproduce(chosen(runs_of(open_log(changed)), None), opened, board, None, None)
        spoilt = with_frames(changed, tmp_path / "wrong.plog", wrong)
        bad = reproduce(chosen(runs_of(open_log(spoilt)), None), opened, board, None, None)
    steps, said = done.recorded.run.steps, done.summary()
    takes = board != "virtual"
    assert done.verdict == ("pass" if takes else "unverified") and done.compared == said["steps"] == steps
    assert done.unverified_from == (None if takes else first) and not done.board_differs and not done.differ
    assert said["recorded"]["board_steps"] == (steps if takes else first) and said["metrics_of_steps"] == 5
    assert len(done.run.inputs.raw) == 5, "the report has the beginning"
    assert f"the board equals the model in {steps if takes else first} steps" in done.statement().text
    assert bad.verdict == "fail" and bad.differ == 1 and bad.divergence is not None
    assert (bad.divergence.step, bad.divergence.signal) == (first + 3, "tilt")


def test_a_board_that_differs_late_in_a_long_run_is_found(changed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_replay, "DETAIL_STEPS", 5)
    monkeypatch.setattr(run_parts, "PART_STEPS", 8)
    honest = InProcessParts.run

    def late(self: InProcessParts, raw: RawCounts, setpoint: Setpoints) -> npt.NDArray[np.uint32]:
        digests = honest(self, raw, setpoint)
        digests[-1] ^= 1
        return digests

    monkeypatch.setattr(InProcessParts, "run", late)
    done = on_native(changed)
    assert done.verdict == "fail" and done.board_differs > 3 and not done.differ
    assert "steps of the board differ, the first at step" in done.statement().text


@pytest.mark.parametrize("suffix", ["blf", "asc", "log", "trc"])
def test_files_of_other_tools_carry_changes_too(changed: Path, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run.{suffix}"
    assert front.main(["export", str(changed), str(path)]) == 0
    done = on_native(path)
    assert done.verdict == "pass" and len(done.run.changes) == 2


def test_a_change_without_its_table_is_unverified_from_its_step_on(changed: Path, tmp_path: Path) -> None:
    """As on the link of another host: it receives PARAM_USED alone. A table that is read afterwards shows it."""
    log, first = read_log(changed), step_of_change(changed)

    def unheard(frames: Frames) -> Frames:
        report = places(frames, "PARAM_STAGED") + places(frames, "PARAM_VALUE")
        return np.delete(frames, report)

    done = on_native(with_frames(changed, tmp_path / "unheard.plog", unheard))
    assert (done.verdict, done.unverified_from, done.differ) == ("unverified", first, 0)
    assert done.statement().text.endswith(f"the parameters changed at step {first}, and no frame has the new ones")
    read = with_frames(
        changed, tmp_path / "read.plog", lambda frames: np.delete(frames, places(frames, "PARAM_STAGED"))
    )
    # The whole table twice; the number of parameters grows.
    assert len(places(log.frames, "PARAM_VALUE")) > 2 * 162
    assert on_native(read).unverified_from == step_of_change(changed, 1), "the first was read before the second"


def test_a_table_with_another_crc_is_not_the_one_in_use(changed: Path, tmp_path: Path) -> None:
    def other(frames: Frames) -> Frames:
        place = places(frames, "PARAM_USED")[0]
        data = bytearray(frames["data"][place].tobytes())
        data[5] ^= 1
        sealed_again(frames, place, bytes(data))
        return frames

    done = on_native(with_frames(changed, tmp_path / "crc.plog", other))
    assert (done.verdict, done.unverified_from) == ("unverified", step_of_change(changed))


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("step", [0, 1, 0x7FFF, 0x8000, 0xFFFF])
def test_an_announcement_of_an_impossible_step_never_passes(
    changed: Path, tmp_path: Path, number: int, step: int
) -> None:
    """Before the run, long ago, or never."""

    def lying(frames: Frames) -> Frames:
        place = places(frames, "PARAM_USED")[number]
        data = bytearray(frames["data"][place].tobytes())
        data[2:4] = step.to_bytes(2, "little")
        sealed_again(frames, place, bytes(data))
        return frames

    (recorded,) = runs_of(open_log(with_frames(changed, tmp_path / "lying.plog", lying)))
    assert 0 <= recorded.known <= recorded.run.steps
    if recorded.known:
        assert reproduce(recorded, NativeCore(), "native", None, None).verdict != "pass"
    else:
        report = "the parameters changed at step 0" if step == 0 else "names one before the run"
        assert report in recorded.unknown


def test_a_lost_announcement_leaves_the_steps_from_there_on_unverified(changed: Path, tmp_path: Path) -> None:
    first = step_of_change(changed)
    done = on_native(with_frames(changed, tmp_path / "lost.plog", without("PARAM_USED", 0)))
    assert done.verdict == "unverified" and done.unverified_from is not None and abs(done.unverified_from - first) <= 1
    assert "another table was committed about step" in done.statement().text


def test_a_log_that_was_cut_anywhere_is_reproduced_to_its_end(changed: Path, tmp_path: Path) -> None:
    """Of every length there is a verdict, and it is never that the board was wrong."""
    data, whole_run, lengths = changed.read_bytes(), on_native(changed).compared, []
    for cut in range(len(data) - 1, len(data) // 2, -max(1, len(data) // 60)):
        path = tmp_path / "cut.plog"
        path.write_bytes(data[:cut])
        try:
            done = on_native(path)
        except (UsageError, UnverifiedError) as error:
            assert "\n" not in str(error)
            continue
        assert done.verdict == "pass" and done.compared <= whole_run
        lengths.append(done.compared)
    assert lengths == sorted(lengths, reverse=True) and len(set(lengths)) > 5


def test_a_bus_on_which_a_host_committed_a_table_needs_no_other_parameters(whole: Path, tmp_path: Path) -> None:
    """As a passive logger receives it: the host's PARAM_SET frames, and the board's ACK."""
    log, messages = read_log(whole), protocol()
    run = np.delete(log.frames, places(log.frames, "PARAM_VALUE"))
    values = log.parameter_sets[0].values
    for kp, verdict in ((values["pid.kp_q22"], "pass"), (77, "fail")):
        words = [value & 0xFFFFFFFF for value in {**values, "pid.kp_q22": kp}.values()]
        said = [("PARAM_SET", (index & 15, 0, index, word)) for index, word in enumerate(words)]
        said.append(("ACK", (0, 0, messages["PARAM_COMMIT"].identifier, 0)))
        path = tmp_path / f"bus{kp}.plog"
        with LogWriter(path, {"protocol": log.head.get("protocol")}) as writer:
            writer.add([(messages[name].identifier, messages[name].pack(*words)) for name, words in said], 0.0)
            writer.flush(at_once=True)
            writer._blocks.append("FRMS", run.tobytes())
        assert on_native(path).verdict == verdict


def test_a_csv_of_a_log_points_to_the_log(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["export", str(whole), str(tmp_path / "run.csv")]) == 0
    for system in systems.with_part("replay"):
        assert front.main(["replay", str(tmp_path / "run.csv"), "--system", system, "--board", "native"]) == 2
        assert "run.csv was exported from a log of a board: replay the log itself" in capsys.readouterr().err


def test_a_run_whose_beginning_is_missing_cannot_be_reproduced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = recorded_run(tmp_path / "late.plog", late=True)
    assert front.main(["replay", str(path), "--board", "native"]) == 3
    said = capsys.readouterr().err
    assert "run 1 cannot be reproduced: its beginning is missing: the recording begins at step" in said
    assert front.main(["export", str(path), str(tmp_path / "late.csv")]) == 0
    first = (tmp_path / "late.csv").read_text().splitlines()[1].split(",")
    assert int(first[1]) > 5 and float(first[0]) == pytest.approx(0.02 * int(first[1]))


def test_several_runs_of_a_log_are_found_and_chosen(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two recordings of one board in one log; the second ends before step 17. Its RUN_BEGIN may be missing."""
    log = read_log(whole)
    begin = places(log.frames, "ACK")
    known = 16
    for complete in (True, False):
        frames = log.frames if complete else np.delete(log.frames, begin)
        path = tmp_path / f"two{complete}.plog"
        with LogWriter(path, log.head) as writer:
            writer._blocks.append("PARM", json.dumps({"values": log.parameter_sets[0].values}).encode())
            writer._blocks.append("FRMS", frames.tobytes())
            writer._blocks.append("FRMS", frames[: places(frames, "RAW_A")[known]].tobytes())
        runs = runs_of(open_log(path))
        assert len(runs) == 2 and runs[0].known == log_replay.runs_of(log)[0].known > runs[1].known == known
        for number in (None, 1, 2):
            done = on_native(path, number)
            assert done.verdict == "pass" and done.compared == runs[(number or 1) - 1].known
    assert front.main(["replay", str(path), "--board", "native", "--log-run", "3"]) == 2
    assert "there is no run 3" in capsys.readouterr().err


def test_the_first_seconds_are_enough_when_they_are_asked_for(whole: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["replay", str(whole), "--board", "native", "--seconds", "0.2", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["steps"] == said["recorded"]["steps"] == 10


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (["--axis", "y"], "--axis is for recordings in units"),
        (["--period-us", "5000"], "--period-us is for recordings in units"),
        (["--decimate", "3"], "--decimate is for recordings in units"),
        (["--system", ANOTHER], f"whole.plog is of quad, not of {ANOTHER}"),
        (["--seconds", "0.001"], "less than one period"),
    ],
)
def test_what_a_log_cannot_be_asked_is_one_sentence(
    whole: Path, more: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert front.main(["replay", str(whole), "--board", "native", *more]) == 2
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1


@pytest.mark.parametrize("suffix", [".plog", ".blf", ".asc", ".log", ".trc", ".mf4"])
def test_a_file_that_is_none_is_one_sentence(
    tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for logger in (logging.root, logging.getLogger("can")):  # as outside of pytest, which takes what is logged
        monkeypatch.setattr(logger, "handlers", [])
    path = tmp_path / f"file{suffix}"
    for data in (b"", b"nothing of the kind\n" * 50, bytes(range(256)) * 40):
        path.write_bytes(data)
        assert front.main(["replay", str(path), "--board", "native"]) == 2
        said = capsys.readouterr().err
        assert said.startswith("plumb: ") and said.count("\n") == 1 and "defect" not in said


def test_frames_that_are_no_plumb_boards_are_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "car.plog"
    frames = np.zeros(50, FRAME)
    frames["can_id"], frames["length"] = np.arange(50) + 0x700, 8
    with LogWriter(path, {}) as writer:
        writer._blocks.append("FRMS", frames.tobytes())
    assert front.main(["replay", str(path), "--board", "native"]) == 2
    assert "none of the 50 frames of car.plog is plumb's" in capsys.readouterr().err
