"""Faults of the source of injected samples: it stops, repeats its samples, or loses some."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from plumb import systems
from plumb.link import parameter_table
from plumb.link.sample_codec import layout_of
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.reports import Told
from plumb.proof.faults.sample_source import Source
from plumb.proof.faults.scene import SEED, Scene, arm, command, noise
from plumb.spec import declarations
from plumb.spec.parameter_file import by_name
from plumb.systems.contracts import PINS, CommandedPins

CAUSE = Told("EVENTS", "disarm_cause", 1 << 7)
LOST = Told("COUNTERS", "lost")
NOISE_LSB = 1.5
"""Noise of a sensor channel, so that it does not count as stuck; a counter at rest has none."""
SETPOINT = 1 << 24
"""1.4 degrees, as a binary angle: the outputs leave neutral."""
STARTS_S, READY_S = 0.1, 5.0
"""Of the samples before the board's word counts; longest time until the board is ready to be armed."""
DRIVING_S = 0.3
GAP_S = 0.04
"""Two samples this far apart keep the board armed."""


def at_rest(still: Sequence[tuple[int, float]]) -> Callable[[float], list[int]]:
    """Counts of a vehicle at rest as a function of time. still: count and standard deviation of its noise, a channel
    each."""
    drawn = [(count, noise(f"{SEED} {channel}", sigma)) for channel, (count, sigma) in enumerate(still)]
    return lambda time_s: [count + round(added(time_s)) for count, added in drawn]


def source_of(scene: Scene) -> Source:
    if scene.source is None:
        raise TypeError("no samples are injected in this scene")
    return scene.source


def is_ready(scene: Scene) -> bool:
    """Whether the board misses nothing for being armed."""
    return scene.session.telemetry.get("PLAUSIBILITY", {}).get("missing") == 0


def injected(scene: Scene) -> None:
    """Begin a run on injected samples, arm, and send setpoints. The samples are those of the vehicle at the start of
    its scenario."""
    table = by_name(parameter_table.read_table(scene.session))
    parts = systems.load(scene.name, PINS)
    drawn = systems.load(scene.name).scenario(parts.SCENARIO, SEED, period_us=table["period_us"])
    channels = declarations.system(scene.name).channels
    measured = zip(channels, drawn.counts()[0], strict=False)
    still = [(int(count), NOISE_LSB if channel.calibration else 0.0) for channel, count in measured]
    scene.session.begin("REALTIME_INJECTED", frames=parts.FRAMES)
    scene.source = Source(at_rest(still), layout_of(scene.name), table["period_us"] * 1e-6, scene.now_s)
    scene.run(STARTS_S)
    scene.run_until(lambda: is_ready(scene), READY_S)  # while the session waits by itself, no samples are sent
    arm(scene)
    if isinstance(scene.live, CommandedPins):
        command(scene)
    else:
        scene.session.set_setpoint(SETPOINT)
    scene.run(DRIVING_S)


def cease(scene: Scene) -> None:
    source_of(scene).stopped = True


def repeat(count: int) -> Action:
    """The source repeats its last samples in a loop."""

    def inject(scene: Scene) -> None:
        source_of(scene).circle = count

    return inject


def lose(scene: Scene) -> None:
    """Samples in a row are lost, so that two that arrive are GAP_S apart."""
    source = source_of(scene)
    missing = round(GAP_S / source.period_s) - 1
    source.number += missing
    source.next_s += missing * source.period_s


def freeze(scene: Scene) -> None:
    """The first channel keeps its count, the others go on."""
    source = source_of(scene)
    counts, first = source.counts, source.counts(scene.now_s)[0]
    source.counts = lambda time_s: [first, *counts(time_s)[1:]]


FAULTS = (
    Fault("samples-cease", "host", "no injected SAMPLE comes any more, keep-alives do", cease, "silence", (CAUSE,),
          prepare=injected),
    Fault("sample-repeated", "host", "the last injected SAMPLE is sent every period, keep-alives go on", repeat(1),
          "silence", (CAUSE,), prepare=injected),
    Fault("samples-in-a-circle", "host", "the last 16 injected SAMPLEs are sent in a circle, keep-alives go on",
          repeat(16), "silence", (CAUSE,), prepare=injected),
    Fault("samples-40-ms-apart", "host", "two injected SAMPLEs come 40 ms apart, those between are lost", lose,
          "gap", (LOST,), prepare=injected, moves_on=True),
    Fault("sample-channel-frozen", "host", "the first channel of the injected SAMPLEs stands still", freeze, "sensor",
          (Told("EVENTS", "disarm_cause", 1 << 3),), prepare=injected),
)  # fmt: skip
