"""`plumb bridge --mavlink`: what a board says, for ground stations."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys

from plumb.cli import options

OTHERS = ("system", "tuning", "keep_parameters", "arm", "shadow", "direct", "serve", "carry")


def main(arguments: argparse.Namespace) -> int:
    from plumb import systems
    from plumb.boards import open_link_board
    from plumb.errors import UsageError
    from plumb.link import monitor
    from plumb.process_signals import endings, raise_ending
    from plumb.systems.mavlink import MAVLINK
    from plumb.writers import mavlink_stream

    given = [f"--{name.replace('_', '-')}" for name in OTHERS if getattr(arguments, name)]
    if given:
        raise UsageError(f"--mavlink only listens to a board: leave out {', '.join(given)}")
    if arguments.board is not None:
        raise UsageError("--mavlink listens to one board: name one BUS")
    target = mavlink_stream.parse_target(arguments.mavlink)
    mavlink_stream.require()
    options.check_duration(arguments.seconds)
    with contextlib.ExitStack() as stack:
        session = stack.enter_context(open_link_board(arguments.sensor)).session
        system = session.system
        vehicle = systems.load(system, MAVLINK) if system in systems.with_part(MAVLINK.name) else None
        stream = mavlink_stream.MavlinkStream(target, system, vehicle, arguments.tlog)
        stack.callback(stream.close)
        if arguments.run:
            stream.begin()
            if vehicle is not None and vehicle.FRAMES:
                session.begin("REALTIME_LIVE", frames=vehicle.FRAMES)
            else:
                monitor.begin_live(session)
            stack.callback(session.end)
        else:
            monitor.read_only(session)
        if vehicle is None:
            print(f"plumb: {system}: no ATTITUDE and no RC_CHANNELS are sent", file=sys.stderr)
        with endings() as caught:
            for snapshot in monitor.watch(session, arguments.seconds, None, stream.feed):
                if caught:
                    break
                stream.show(snapshot)
    sent = dict(sorted(stream.sent.items()))
    print(json.dumps(sent) if arguments.json else "sent: " + ", ".join(f"{n} {name}" for name, n in sent.items()))
    if caught:
        raise_ending(caught)
    return 0
