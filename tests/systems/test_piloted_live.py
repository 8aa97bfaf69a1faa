"""Live runs that a pilot flies or rides: his CRSF, the sensors and the motors at the pins of the simulated chip."""

from __future__ import annotations

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

import plumb
from plumb.errors import LinkError, UsageError
from plumb.flash.image import find_image
from plumb.spec import crsf, images
from plumb.systems.quadrotor import courses
from plumb.systems.wheels import rides

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def flash_images() -> None:
    try:
        for name in ("quadrotor", "wheels"):
            find_image(images.running(name))
    except UsageError as missing:
        pytest.skip(str(missing))


SEED = 1013
"""Of a hundred the one whose pilot acts first, 2.03 s after the take-off: a simulated second takes seconds."""


def test_a_vehicle_leans_as_its_pilot_asks_and_its_steps_are_the_model_bit_for_bit() -> None:
    acts_s = courses.drawn("lean", SEED).acts_s
    done = plumb.run("quadrotor", board="virtual", live=True, scenario="lean", seed=SEED, seconds=acts_s + 1.0)
    assert done.verdict == "pass" and done.bit_exact
    assert done["rotor_0"][-1] > 0.1, "it flies on what leaves the pins"
    lean_deg, height_m = done.metrics["lean_max_deg"], done.metrics["height_least_m"]
    assert isinstance(lean_deg, float) and abs(lean_deg - courses.LEAN_DEG) < 2.0
    assert isinstance(height_m, float) and abs(height_m - courses.HEIGHT_M) < 0.3


def test_a_run_without_frames_of_its_pilot_does_not_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crsf.Pilot, "frames", lambda *_: b"")
    with pytest.raises(LinkError, match="no frames from the pilot's receiver"):
        plumb.run("quadrotor", board="virtual", live=True, scenario="lean", seconds=4.5)


def test_a_ride_follows_the_receiver_bit_for_bit() -> None:
    done = plumb.run("wheels", board="virtual", live=True, scenario="receiver", seconds=rides.BEGINS_S + 2.0)
    assert done.verdict == "pass" and done.bit_exact
    off_mps = done.metrics["velocity_rmse_mps"]
    assert isinstance(off_mps, float) and off_mps < 0.3
    assert max(abs(done["velocity_mps"])) > 0.2
