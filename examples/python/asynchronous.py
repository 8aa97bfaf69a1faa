"""A board in asyncio: it is armed for a task, and disarmed with it."""

import asyncio

import plumb


async def follow(board: plumb.aio.Board, reached: asyncio.Event) -> None:
    async with board.armed():  # left by return, exception or cancellation: disarmed
        await board.set_setpoint(10.0)  # deg
        async for sample in board.stream():
            if sample.time_s >= 2.0:
                print(f"{sample.time_s:.1f} s, armed: {sample.armed}")
                break
        reached.set()
        await asyncio.Event().wait()  # something that never comes


async def main() -> None:
    async with plumb.aio.connect("native", system="quad") as board:
        await board.params.update({"pid.kp": 0.05, "arm_hold_ms": 0})
        print(f"pid.kp = {await board.params.get('pid.kp'):.4f}")
        reached = asyncio.Event()
        task = asyncio.create_task(follow(board, reached))
        await reached.wait()
        task.cancel()
        await asyncio.wait([task])
        last = [sample async for sample in board.stream(seconds=0.2)][-1]
        print(f"armed: {last.armed}, {', '.join(last.health.disarm_cause)}")


asyncio.run(main())

# Prints:
#     pid.kp = 0.0500
#     2.0 s, armed: True
#     armed: False, the host disarmed
