"""plumb.aio: the same samples as plumb.connect, and a board that is disarmed with the task that armed and with a loop
that hangs. On the shipped main loop in this process, whose time is simulated."""

from __future__ import annotations

import asyncio
import inspect
import subprocess
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine

import pytest

import plumb
from plumb.aio import link_thread
from plumb.aio.link_thread import LinkThread
from plumb.aio.samples import _Sink
from plumb.boards.native.mcu import NativeMcu
from plumb.boards.native.port import FollowingUart, NativePort
from plumb.link.transports.byte_stream import ObjectStream
from plumb.link.transports.slcan_bus import PlumbBus
from support.cut_cable import Cable
from support.declared_systems import without_part

NEUTRAL_HALFUS = 2000
SILENT_HOST_US = 50_000
"""Time within which the outputs of a board are safe whose host is silent."""
VALUE_US = 10_000
"""Interval at which the board asks for a keep-alive."""


def thread_of(board: plumb.aio.Board) -> LinkThread:
    assert board._thread is not None
    return board._thread


def chip(board: plumb.aio.Board) -> NativeMcu:
    opened = thread_of(board)._board
    assert opened is not None and isinstance(opened._talks_to, NativePort)
    return opened._talks_to.mcu


def line(board: plumb.aio.Board) -> FollowingUart:
    opened = thread_of(board)._board
    assert opened is not None and isinstance(opened._talks_to, NativePort)
    bus = opened._talks_to.session.bus
    assert isinstance(bus, PlumbBus) and isinstance(bus._stream, ObjectStream)
    assert isinstance(bus._stream._channel, FollowingUart)
    return bus._stream._channel


def driven(mcu: NativeMcu) -> bool:
    return bool(mcu.wires.pulse_halfus[0] != NEUTRAL_HALFUS)


async def armed_and_driving(board: plumb.aio.Board) -> NativeMcu:
    """Arm, and take samples until its outputs leave neutral."""
    await board.params.set("arm_hold_ms", 0)
    await board.arm()
    mcu = chip(board)
    async for _ in board.stream():
        if driven(mcu):
            break
    assert mcu.wires.armed
    return mcu


async def cause_of(board: plumb.aio.Board) -> tuple[str, ...]:
    return [sample async for sample in board.stream(0.3)][-1].health.disarm_cause


async def until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.001)


def quad() -> plumb.aio.Board:
    return plumb.aio.connect("native", system="quad")


def test_the_facade_takes_what_the_original_takes() -> None:
    """Each public name of `plumb.aio.Board` is one of `plumb.Board` with the same arguments; a new argument of
    `plumb.connect` is one of `plumb.aio.connect`."""

    def arguments(of: Callable[..., object]) -> list[tuple[str, object, object]]:
        return [(one.name, one.kind, one.default) for one in inspect.signature(of).parameters.values()]

    assert arguments(plumb.aio.connect) == arguments(plumb.connect)
    with pytest.raises(TypeError, match="sytem"):
        plumb.aio.connect("native", sytem="quad")  # type: ignore[call-arg]
    names = {name for name in vars(plumb.aio.Board) if not name.startswith("_")}
    assert names == {"identity", "params", "stream", "arm", "disarm", "armed", "set_setpoint", "set_commands"}
    for name in names:
        facade, original = getattr(plumb.aio.Board, name), getattr(plumb.Board, name)
        if callable(original):
            assert arguments(facade) == arguments(original), name


def test_the_samples_are_those_of_connect() -> None:
    async def collected() -> list[plumb.Sample]:
        async with quad() as board:
            assert "quad" in (await board.identity()).systems
            return [sample async for sample in board.stream(0.5)]

    with plumb.connect("native", system="quad") as board:
        assert "quad" in board.identity.systems
        assert asyncio.run(collected()) == list(board.stream(0.5))


def test_simulated_time_stands_still_until_a_sample_is_taken() -> None:
    async def body() -> None:
        async with quad() as board:
            samples = board.stream()
            await anext(samples)
            sink = thread_of(board)._sink
            assert isinstance(sink, _Sink)
            await until(sink.full)  # the next one waits
            now_us = chip(board).now_us
            await asyncio.sleep(0.05)
            assert chip(board).now_us == now_us and sink._counted - sink._taken == 1

    asyncio.run(body())


def test_parameters_are_read_and_written() -> None:
    async def body() -> None:
        async with quad() as board:
            params = board.params
            await params.set("pid.kp", 0.05)
            await params.update({"esc.max": 1900.0, "arm_hold_ms": 500})
            assert await params.get("pid.kp") == pytest.approx(0.05, rel=1e-3)
            assert (await params.read())["esc.max_us"] == 1900.0
            assert (await params.describe("pid.kp")).unit == "1/deg"
            await params.save()
            with pytest.raises(plumb.UsageError, match="too large"):
                await params.set("pid.kp", 5.0)
            with pytest.raises(plumb.UsageError, match="no parameter"):
                await params.get("pid.ko")

    asyncio.run(body())


def test_a_block_that_is_armed_ends_disarmed_by_command() -> None:
    async def body() -> None:
        async with quad() as board:
            await board.params.set("arm_hold_ms", 0)
            mcu = chip(board)
            with pytest.raises(plumb.UsageError, match="no run"):
                await board.set_setpoint(1.0)
            async with board.armed():
                armed = []
                async for sample in board.stream(1.0):
                    await board.set_setpoint(5.0)
                    armed.append(sample.armed)
                assert driven(mcu) and armed[-1]
                for value in (1e9, 10**400, None, float("nan")):
                    with pytest.raises(plumb.UsageError, match="at most"):
                        await board.set_setpoint(value)  # type: ignore[arg-type]
            assert not mcu.wires.armed
            assert await cause_of(board) == ("the host disarmed",)
            await board.set_setpoint(0.0)
            with pytest.raises(RuntimeError, match="of the caller"):
                async with board.armed():
                    raise RuntimeError("of the caller")
            assert not mcu.wires.armed

    asyncio.run(body())


async def waits_for_ever(board: plumb.aio.Board, mcus: list[NativeMcu]) -> None:
    mcus.append(await armed_and_driving(board))
    await asyncio.Event().wait()


async def returns(board: plumb.aio.Board, mcus: list[NativeMcu]) -> None:
    mcus.append(await armed_and_driving(board))


async def raises(board: plumb.aio.Board, mcus: list[NativeMcu]) -> None:
    mcus.append(await armed_and_driving(board))
    raise RuntimeError("of the caller")


@pytest.mark.parametrize("work", [waits_for_ever, returns, raises])
def test_the_board_is_disarmed_with_the_task_that_armed(
    work: Callable[[plumb.aio.Board, list[NativeMcu]], Coroutine[object, object, None]],
) -> None:
    """Cancelled, returned, or ended by an exception, while the rest of the program goes on."""

    async def body() -> None:
        async with quad() as board:
            mcus: list[NativeMcu] = []
            task = asyncio.create_task(work(board, mcus))
            await until(lambda: bool(mcus))
            if work is waits_for_ever:
                await asyncio.sleep(0.01)
                assert mcus[0].wires.armed
                task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            await board.identity()  # a request later, the one to disarm is done
            assert not mcus[0].wires.armed
            assert await cause_of(board) == ("the host disarmed",)

    asyncio.run(body())


def blocked_until(condition: Callable[[], bool]) -> None:
    """What a hung callback does: the loop does not come round."""
    while not condition():
        time.sleep(0.0005)


def test_a_loop_that_is_blocked_is_a_silent_host(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[int, bool]] = []
    consent = LinkThread.consent

    def noted(self: LinkThread) -> bool:
        said = consent(self)
        given.append((mcus[0].now_us if mcus else 0, said))
        return said

    mcus: list[NativeMcu] = []
    monkeypatch.setattr(LinkThread, "consent", noted)

    async def body() -> None:
        async with quad() as board:
            mcus.append(await armed_and_driving(board))
            (mcu,) = mcus
            given.clear()
            await until(lambda: len(given) > 20)  # without a stream, too, it is kept alive
            assert mcu.wires.armed
            begin_us = mcu.now_us
            blocked_until(lambda: not mcu.wires.armed or mcu.now_us - begin_us > 1_000_000)
            assert not mcu.wires.armed
            last_us = max(time_us for time_us, said in given if said)
            assert last_us <= begin_us + VALUE_US  # one may have been under way
            assert mcu.now_us - last_us <= SILENT_HOST_US + VALUE_US
            assert not any(said for time_us, said in given if time_us > begin_us + VALUE_US)
            assert await cause_of(board) == ("the keep-alive was lost",)

    asyncio.run(body())


@pytest.mark.parametrize("closed", [False, True], ids=["stopped", "closed"])
def test_a_loop_that_runs_no_more_is_a_silent_host(closed: bool) -> None:
    loop = asyncio.new_event_loop()
    board = quad()

    async def body() -> NativeMcu:
        await board.__aenter__()
        return await armed_and_driving(board)

    try:
        task = loop.create_task(body())
        task.add_done_callback(lambda _: None)
        mcu = loop.run_until_complete(forever_after(task))
        assert mcu.wires.armed
        if closed:
            loop.close()
        begin_us = mcu.now_us
        blocked_until(lambda: not mcu.wires.armed or mcu.now_us - begin_us > 1_000_000)
        assert not mcu.wires.armed
        if closed:
            thread_of(board).join()
    finally:
        thread_of(board).leave()
        thread_of(board).join()
        loop.close()


async def forever_after(task: asyncio.Task[NativeMcu]) -> NativeMcu:
    """The result, while the task that armed is held open by somebody else."""
    return await task


def test_a_task_that_leaves_its_samples_is_one_that_hangs() -> None:
    """On a board in real time: what is not read any more is not kept alive either."""

    async def body() -> None:
        async with quad() as board:
            mcu = await armed_and_driving(board)
            await until(lambda: thread_of(board)._sink is None)
            thread_of(board)._most_behind_s = link_thread.BEHIND_S
            samples = board.stream()
            first = await anext(samples)
            begin_us = mcu.now_us
            sink = thread_of(board)._sink
            assert sink is not None
            await until(sink.full)
            stood_us = -1
            while stood_us != mcu.now_us:  # one more turn may be under way
                stood_us = mcu.now_us
                await asyncio.sleep(0.02)
            assert mcu.wires.armed and mcu.now_us - begin_us < 1.2e6 * link_thread.BEHIND_S
            line(board).pass_us(SILENT_HOST_US)
            assert not mcu.wires.armed
            async for sample in samples:  # all that waited, and then what comes
                assert sample.step == first.step + 1
                first = sample
                if not sample.armed:
                    break

    asyncio.run(body())


def test_one_stream_at_a_time_and_a_broken_off_one_is_over() -> None:
    async def body() -> None:
        async with quad() as board:
            async for _ in board.stream():
                with pytest.raises(plumb.UsageError, match="open already"):
                    await anext(board.stream())
                break
            last = [sample async for sample in board.stream(0.1)][-1]
            samples = board.stream()
            assert (await anext(samples)).step > last.step
            await samples.aclose()
            assert [sample async for sample in samples] == []
            assert [sample async for sample in board.stream(0.1)][-1].step > last.step
            with pytest.raises(plumb.UsageError, match="more than nothing"):
                await anext(board.stream(-1.0))

    asyncio.run(body())


def test_every_task_that_takes_samples_ends_when_the_board_is_closed() -> None:
    async def taken(samples: plumb.aio.Samples) -> int:
        return len([sample async for sample in samples])

    async def body() -> None:
        async with quad() as board:
            samples = board.stream()
            tasks = [asyncio.create_task(taken(samples)) for _ in range(2)]
            await asyncio.sleep(0.02)
        async with asyncio.timeout(10.0):
            assert sum(await asyncio.gather(*tasks)) > 0

    asyncio.run(body())


def test_one_task_arms() -> None:
    async def body() -> None:
        async with quad() as board:
            await armed_and_driving(board)

            async def other() -> None:
                await board.arm()

            with pytest.raises(plumb.UsageError, match="another task"):
                await asyncio.create_task(other())
            assert chip(board).wires.armed
            await board.disarm()  # anybody may

    asyncio.run(body())


def test_arming_that_is_cancelled_under_way_leaves_it_disarmed() -> None:
    async def body() -> None:
        async with quad() as board:
            await board.params.set("arm_hold_ms", 0)
            task = asyncio.create_task(board.arm())
            await until(lambda: thread_of(board).holder is task)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            await board.identity()
            assert thread_of(board).holder is None and not chip(board).wires.armed
            await armed_and_driving(board)

    asyncio.run(body())


def test_arming_that_is_refused_holds_nothing() -> None:
    async def body() -> None:
        async with plumb.aio.connect("native", system=without_part("pins")) as board:
            with pytest.raises(plumb.UsageError, match="no sensors of its own"):
                await board.arm()
            assert thread_of(board).holder is None

    asyncio.run(body())


def test_what_is_not_open_says_so() -> None:
    async def body() -> None:
        board = quad()
        with pytest.raises(plumb.UsageError, match="async with"):
            await board.identity()
        async with board:
            pass
        with pytest.raises(plumb.UsageError, match="closed"):
            await board.disarm()
        with pytest.raises(plumb.UsageError, match="connect again"):
            await board.__aenter__()
        for name, error in (("nativ", plumb.UsageError), ("serial:/dev/there-is-no-such-port", plumb.LinkError)):
            with pytest.raises(error):
                async with plumb.aio.connect(name):
                    pass

    asyncio.run(body())
    for one in threading.enumerate():
        if isinstance(one, LinkThread):
            one.join()


def lost_board(
    monkeypatch: pytest.MonkeyPatch, body: Callable[[plumb.aio.Board, Cable, list[str]], Awaitable[None]]
) -> list[str]:
    """Run the body with a board behind a cable; the reasons why it was lost."""
    cable, reasons = Cable("serial").laid(monkeypatch), list[str]()

    async def run() -> None:
        async with plumb.aio.connect("serial:memory", reconnect=True, on_lost=reasons.append) as board:
            threads.append(thread_of(board))
            await body(board, cable, reasons)

    threads: list[LinkThread] = []
    asyncio.run(run())
    threads[0].join(10.0)
    assert not threads[0].is_alive()
    return reasons


def test_a_lost_board_is_a_pause_and_requests_fail_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    async def body(board: plumb.aio.Board, cable: Cable, reasons: list[str]) -> None:
        samples = board.stream()
        last = await anext(samples)
        cable.cut = True
        waiting = asyncio.create_task(first_after(samples))
        await until(lambda: bool(reasons))
        with pytest.raises(plumb.LinkError, match="is out"):
            await board.params.get("pid.kp")
        cable.plug_in_again()
        after = await waiting
        assert after.gap is not None and after.gap.steps is not None and after.step > last.step + 1
        assert await board.params.get("pid.kp")

    async def first_after(samples: plumb.aio.Samples) -> plumb.Sample:
        return await anext(sample async for sample in samples if sample.gap)

    (reason,) = lost_board(monkeypatch, body)
    assert "is out" in reason


def test_leaving_while_a_board_is_lost_does_not_wait_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    async def body(board: plumb.aio.Board, cable: Cable, reasons: list[str]) -> None:
        samples = board.stream()
        await anext(samples)
        cable.cut = True
        task = asyncio.create_task(anext(samples))
        await until(lambda: bool(reasons))
        task.cancel()

    assert lost_board(monkeypatch, body)


def test_a_stream_that_is_broken_off_while_the_board_is_lost_makes_room_for_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def body(board: plumb.aio.Board, cable: Cable, reasons: list[str]) -> None:
        samples = board.stream()
        first = await anext(samples)
        cable.cut = True
        task = asyncio.create_task(taken(samples))
        await until(lambda: bool(reasons))
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        del samples, task
        other = asyncio.create_task(anext(board.stream()))
        await asyncio.sleep(0.01)
        cable.plug_in_again()
        after = await other
        assert after.gap is not None and after.step > first.step + 1

    async def taken(samples: plumb.aio.Samples) -> None:
        async for _ in samples:
            pass

    assert lost_board(monkeypatch, body)


FORGOTTEN = """
import asyncio, atexit, plumb
mcus = []
atexit.register(lambda: print("armed", mcus[0].wires.armed))  # after what is registered later
board = plumb.aio.connect("native", system="quad")
loop = asyncio.new_event_loop()
async def begin():
    await board.__aenter__()
    await board.params.set("arm_hold_ms", 0)
    await board.arm()
    mcus.append(board._thread._board._talks_to.mcu)
loop.run_until_complete(begin())
"""


def test_a_program_that_ends_without_closing_leaves_the_board_disarmed() -> None:
    done = subprocess.run([sys.executable, "-c", FORGOTTEN], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "armed 0\n", "")
