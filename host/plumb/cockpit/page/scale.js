// The values and the ticks of an axis.

const STEPS = [1, 2, 5, 10], ROOM = 0.08, SMALLEST_PART = 0.4;

// Distance of ticks, at least `rough`: 1, 2 or 5 of a decade.
export function tickStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * STEPS.find((n) => n * power >= rough * (1 - 1e-9));
}

// Places after the point that ticks of this distance need.
export const placesOf = (step) => Math.max(0, -Math.floor(Math.log10(step) + 1e-9));

// A number with so many places; a value that rounds to zero has no sign.
export function fixed(value, places) {
  return (Number(value.toFixed(places)) + 0).toFixed(places);
}

// A value with about four digits.
export function shown(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  return fixed(value, size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : 3);
}

// The range of an axis for values from low to high, to half ticks: `before` stays as long as the values fit in it and
// fill SMALLEST_PART of it, so that the picture stands still. least: its least height.
export function rangeFor(low, high, before, least) {
  if (low > high) return before ?? { bottom: -1, top: 1, step: 0.5 };
  const height = Math.max(high - low, Math.abs(high) * 2e-4, least);
  if (before && low >= before.bottom && high <= before.top && height >= SMALLEST_PART * (before.top - before.bottom)) {
    return before;
  }
  const middle = (low + high) / 2, room = height * (0.5 + ROOM), step = tickStep(2 * room / 5);
  const grain = step / 2;
  return { bottom: Math.floor((middle - room) / grain) * grain, top: Math.ceil((middle + room) / grain) * grain, step };
}
