"""Thrust of a hover, drag of the rotors and offsets of the accelerometer of a vehicle, from a flight.

The thrust of a vehicle in the air has no component across its body: what the accelerometer measures there is drag by
mass, -d v, and its own offset. The velocity is the integral of the acceleration, with the attitude of the gyro alone,
in windows of WINDOW_S. In each of them the velocity at its begin, less the wind, is unknown, and so are the tilt at its
begin and a drift of the gyro, which add a line and a parabola: these are fitted together with d. A gust moves the
vehicle and the measured drag together. The instrument of the fit is therefore the velocity that the thrust alone gives.

A thrust command u that gives the acceleration f g along the thrust shows a hover at u f^-k; k is fitted, too.

Intervals are at 95 %, from the spread between windows (jackknife), and hold for flights like this one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from plumb.boards.contract import RawCounts, Setpoints
from plumb.contract.parameters import ControlParams
from plumb.errors import UsageError
from plumb.spec.arrays import BoolArray, FloatArray
from plumb.spec.system_parts import Part

Steps = npt.NDArray[np.int_]

G_MPS2 = 9.80665
WINDOW_S, BLOCK_S, SETTLES_S = 6.0, 0.12, 1.0
LEAST_WINDOWS = 6
HOVERS_G = (0.8, 1.25)
"""Accelerations of blocks that determine the thrust of a hover."""
AIRBORNE_SHARE = 0.7
"""Share of the usual thrust above which a vehicle flies."""
SLOW_RADPS = 1.0
"""Rate of roll and pitch of such a block: rotors that turn a vehicle give more thrust than their mean command."""
EXPONENT, LEAST_SPREAD = 2.0 / 3.0, 0.03
"""k of a thrust that grows with the power 1.5 of its command, where log f spreads too little to fit it."""
MOST_UNCERTAIN = 0.4
"""Half the interval of the drag by the drag: a flight that leaves more does not determine it."""
SCALE = 0.015
"""Standard deviation of the scale of a calibrated accelerometer, which velocity and weight have, too; and what is left
of a drag that grows faster than the speed."""
OFFSET_SEEN_MG = 10.0
"""Half the interval of an offset that counts as seen."""


@dataclass(frozen=True)
class FlownVehicle:
    """A flight, a row a step. rate_radps: less bias, body axes, (steps, 3); force_g: calibrated, body axes, (steps, 3);
    up: estimated vertical in body axes, (steps, 3); thrust: mean command of the rotors, 0 to 1; flies: it is in the
    air."""

    period_s: float
    rate_radps: FloatArray
    force_g: FloatArray
    up: FloatArray
    thrust: FloatArray
    flies: BoolArray


class FlownVehicles(Protocol):
    """flown_vehicle.py of a system: properties of the vehicle that a flight determines."""

    def vehicle(self, params: ControlParams, raw: RawCounts, setpoint: Setpoints, /) -> FlownVehicle:
        """The flight with these parameters and inputs."""

    def settings(self, fit: VehicleFit, /) -> dict[str, float]:
        """Whole names of the settings that it gives, with the values."""


FLOWN_VEHICLE = Part[FlownVehicles]("flown_vehicle", FlownVehicles, without="it does not fly", place="judging")


@dataclass(frozen=True)
class Estimate:
    """A value and half of its interval of 95 %."""

    value: float
    half: float

    def holds(self, truth: float) -> bool:
        return abs(self.value - truth) <= self.half


@dataclass(frozen=True)
class VehicleFit:
    """Properties that a flight determines. drag_per_s: drag by mass and speed, at the speeds of this flight; hover:
    thrust command; offset_g: of the accelerometer along x and y, None where the flight does not determine them: without
    turns of the heading they look like wind. speed_mps: rms of the velocity that the thrust gave within the windows."""

    hover: Estimate
    drag_per_s: Estimate
    offset_g: tuple[Estimate, Estimate] | None
    speed_mps: float
    windows: int


def fit(flight: FlownVehicle) -> VehicleFit:
    """Raises UsageError with one sentence for a flight that does not determine hover and drag."""
    begins, samples = windows(flight)
    if len(begins) < LEAST_WINDOWS:
        raise UsageError(
            f"{len(begins)} windows of {WINDOW_S:g} s in the air are too few, {LEAST_WINDOWS} are needed: fly to and "
            "fro by 15 to 30 deg for a minute, in mode level"
        )
    size = round(BLOCK_S / flight.period_s)
    cut = begins[:, None] + np.arange(samples - samples % size)
    parts = _design(flight, cut, size)
    speed_mps = float(np.sqrt(np.mean(np.sum(parts[:, :, 2] ** 2, axis=1) / (parts.shape[1] / 2.0))))
    solved, halves = _jackknife(lambda used: _drag(parts[used]), len(begins))
    half = float(np.hypot(halves[0], 1.96 * SCALE * solved[0]))
    if solved[0] <= 0.0 or half > MOST_UNCERTAIN * solved[0]:
        raise UsageError(
            f"the flight does not determine the drag: its speed changed by {speed_mps:.1f} m/s rms within"
            f" {WINDOW_S:g} s; fly to and fro by 15 to 30 deg for a minute, in mode level"
        )
    x, y = (Estimate(float(solved[i]), float(halves[i])) for i in (1, 2))
    seen = max(x.half, y.half) <= 1e-3 * OFFSET_SEEN_MG
    hover = _hover(flight, cut, size)
    return VehicleFit(hover, Estimate(float(solved[0]), half), (x, y) if seen else None, speed_mps, len(begins))


def in_the_air(thrust: FloatArray, turns: BoolArray, period_s: float) -> BoolArray:
    """Steps in which a vehicle flies, from the thrust alone: a board whose drag is set to 0 detects no take-off.

    thrust: mean command of the rotors; turns: they are on. It flies while the mean of a second is above AIRBORNE_SHARE
    of what is usual in the recording."""
    if not turns.any():
        return np.zeros(len(thrust), np.bool_)
    size = max(round(SETTLES_S / period_s), 1)
    mean = np.convolve(thrust * turns, np.full(size, 1.0 / size), "same")
    usual = float(np.median(mean[turns & (mean > 0.5 * float(mean.max()))]))
    return np.asarray(turns & (mean > AIRBORNE_SHARE * usual))


def windows(flight: FlownVehicle) -> tuple[Steps, int]:
    """First steps of the windows in the air, and the steps of each."""
    samples, settles = round(WINDOW_S / flight.period_s), round(SETTLES_S / flight.period_s)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flight.flies.astype(int), [0]])))
    found = [
        np.arange(start + settles, end - samples + 1, samples)
        for start, end in zip(edges[::2], edges[1::2], strict=True)
    ]
    return np.concatenate([*found, np.zeros(0, np.int_)]).astype(np.int_), samples


def _attitudes(up: FloatArray, rate_radps: FloatArray, period_s: float) -> FloatArray:
    """Body to earth of every step of every window, (windows, steps, 3, 3).

    up: vertical at its begin, (windows, 3); rate_radps: (windows, steps, 3). The heading begins anywhere."""
    z = up / np.linalg.norm(up, axis=-1, keepdims=True)
    x = np.array([1.0, 0.0, 0.0]) - z * z[:, :1]
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    now = np.stack([x, np.cross(z, x), z], axis=1)
    angle = np.linalg.norm(rate_radps, axis=-1)[..., None, None] * period_s
    wx, wy, wz = np.moveaxis(rate_radps * period_s, -1, 0)
    zero = np.zeros_like(wx)
    skew = np.stack([zero, -wz, wy, wz, zero, -wx, -wy, wx, zero], -1).reshape(*wx.shape, 3, 3)
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    turn = np.eye(3) + first * skew + second * (skew @ skew)
    found = np.empty(turn.shape)
    for step in range(rate_radps.shape[1]):
        now = now @ turn[:, step]
        found[:, step] = now
    return np.asarray(found)


def _design(flight: FlownVehicle, cut: Steps, size: int) -> FloatArray:
    """For every window, the acceleration across the body, velocity, instrument and both offsets, less what the unknown
    velocity, tilt and drift of the window explain: (windows, rows, 5), m/s and s."""
    body = _attitudes(flight.up[cut[:, 0]], flight.rate_radps[cut], flight.period_s)
    force = flight.force_g[cut] * G_MPS2
    along = force * np.array([0.0, 0.0, 1.0])
    weight = np.array([0.0, 0.0, G_MPS2])
    times = (np.arange(cut.shape[1]) * flight.period_s / WINDOW_S)[:, None]

    def across(vectors: FloatArray) -> FloatArray:
        """Means of blocks of the components across the body of vectors in earth axes, (windows, rows)."""
        return _rows(np.einsum("wnij,wni->wnj", body, np.broadcast_to(vectors, force.shape))[..., :2], size)

    moved = [
        np.cumsum(np.einsum("wnij,wnj->wni", body, one) - weight, axis=1) * flight.period_s for one in (force, along)
    ]
    unknown = [across(times**power * axis) for power, axes in ((0, 3), (1, 2), (2, 2)) for axis in np.eye(3)[:axes]]
    offsets = [_rows(np.broadcast_to(axis, (*force.shape[:2], 2)), size) for axis in np.eye(2)]
    known = [_rows(force[..., :2], size), -across(moved[0]), -across(moved[1]), *offsets]
    basis, _ = np.linalg.qr(np.stack(unknown, -1))
    columns = np.stack(known, -1)
    return np.asarray(columns - basis @ (np.swapaxes(basis, 1, 2) @ columns))


def _rows(values: FloatArray, size: int) -> FloatArray:
    """Means of blocks of both components, (windows, rows)."""
    count, steps, _ = values.shape
    return np.asarray(values.reshape(count, steps // size, size, 2).mean(axis=2).reshape(count, -1))


def _drag(parts: FloatArray) -> FloatArray:
    """Drag by mass and speed, 1/s, and offsets along x and y, g."""
    measured, velocity, instrument, *offsets = np.moveaxis(parts, -1, 0).reshape(5, -1)
    columns, instruments = np.stack([velocity, *offsets]), np.stack([instrument, *offsets])
    found = np.linalg.lstsq(instruments @ columns.T, instruments @ measured, rcond=1e-9)[0]
    return np.asarray(found / np.array([1.0, G_MPS2, G_MPS2]))


def _hover(flight: FlownVehicle, cut: Steps, size: int) -> Estimate:
    """Thrust command of a hover; raises UsageError where no block determines it."""
    shape = (*cut.shape[:1], -1, size)
    felt = flight.force_g[cut][..., 2].reshape(shape).mean(axis=2)
    thrust = flight.thrust[cut].reshape(shape).mean(axis=2)
    turning = np.abs(flight.rate_radps[cut][..., :2]).max(axis=-1).reshape(shape).max(axis=2)
    used = (felt > HOVERS_G[0]) & (felt < HOVERS_G[1]) & (thrust > 0.01) & (turning < SLOW_RADPS)
    usable = np.flatnonzero(used.any(axis=1))
    if len(usable) < LEAST_WINDOWS:
        raise UsageError("the flight does not determine the thrust of a hover: hold the height for half a minute")
    force, command = np.log(np.where(used, felt, 1.0)), np.log(np.where(used, thrust, 1.0))

    def solved(chosen: Steps) -> FloatArray:
        rows = used[usable[chosen]]
        f, u = force[usable[chosen]][rows], command[usable[chosen]][rows]
        slope = float(np.polyfit(f, u, 1)[0]) if float(np.std(f)) > LEAST_SPREAD else EXPONENT
        return np.array([np.exp(np.mean(u) - slope * np.mean(f))])

    value, half = _jackknife(solved, len(usable))
    return Estimate(float(value[0]), float(np.hypot(half[0], 1.96 * SCALE * value[0])))


def _jackknife(solve: Callable[[Steps], FloatArray], count: int) -> tuple[FloatArray, FloatArray]:
    """A solution of all windows, and half of the interval of 95 % of each of its values."""
    from scipy import stats

    every = np.arange(count)
    whole = solve(every)
    without = np.stack([solve(every[every != one]) for one in every])
    spread = np.sqrt((count - 1) / count * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    return whole, np.asarray(stats.t.ppf(0.975, count - 1) * spread)
