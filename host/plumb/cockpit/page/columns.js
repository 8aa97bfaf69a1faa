// The least and the greatest value of a signal in each pixel column, so that no spike is lost.
//
// Columns are counted from time 0 of the run, and kept in a ring: a row is looked at once, when it arrives. Where a
// column would have fewer rows than ROWS_PER_COLUMN, the rows themselves are the points of the line.

import { MASK } from "./rows.js";

const ROWS_PER_COLUMN = 2, GAP_ROWS = 2.5, ROWS_BEFORE = 2, COLUMNS_BEFORE = 2;

export class Columns {
  // width: columns that are kept; scale: columns per second; column: of the rows.
  constructor(rows, column, width, scale) {
    const size = 1 << Math.ceil(Math.log2(width + 2));
    Object.assign(this, { rows, column, scale, size });
    this.low = new Float32Array(size);
    this.high = new Float32Array(size);
    this.newest = -1;
    this.row = 0;
  }

  // Takes the rows up to number `end` that are new to it, of those from number `first` on.
  take(first, end) {
    const { rows, scale, size, low, high } = this, values = rows.values[this.column];
    for (let row = Math.max(this.row, first); row < end; row++) {
      const at = row & MASK, column = Math.floor(rows.time[at] * scale), value = values[at];
      if (column > this.newest) this.clear(column);
      if (value !== value || column <= this.newest - size) continue;
      const slot = column & (size - 1);
      if (value < low[slot]) low[slot] = value;
      if (value > high[slot]) high[slot] = value;
    }
    this.row = end;
  }

  clear(upTo) {
    for (let column = Math.max(this.newest + 1, upTo - this.size + 1); column <= upTo; column++) {
      this.low[column & (this.size - 1)] = Infinity;
      this.high[column & (this.size - 1)] = -Infinity;
    }
    this.newest = upTo;
  }

  // Widens range, [low, high], by the columns from `first` on that are less than `end`.
  spread(first, end, range) {
    const { low, high, size } = this, last = Math.min(end, this.newest + 1);
    for (let column = Math.max(first, this.newest - size + 1); column < last; column++) {
      const slot = column & (size - 1);
      if (low[slot] < range[0]) range[0] = low[slot];
      if (high[slot] > range[1]) range[1] = high[slot];
    }
  }

  // Adds the line through the columns from `first` on to the path of a pen; x0: x of time 0.
  trace(pen, first, end, x0, yOf) {
    const { low, high, size } = this, last = Math.min(end, this.newest + 1);
    let drawing = false;
    for (let column = Math.max(first - COLUMNS_BEFORE, this.newest - size + 1, 0); column < last; column++) {
      const slot = column & (size - 1), x = x0 + column + 0.5;
      if (low[slot] > high[slot]) { drawing = false; continue; }
      if (!drawing) pen.moveTo(x, yOf(high[slot]));
      pen.lineTo(x, yOf(high[slot]));
      if (low[slot] < high[slot]) pen.lineTo(x, yOf(low[slot]));
      drawing = true;
    }
  }
}

// Whether a view of so many columns per second has enough rows in a column to keep their extremes.
export const dense = (scale, period) => 1 / scale >= ROWS_PER_COLUMN * period;

// The same for a view with fewer rows than columns: the rows themselves. A row that is missing is a gap.
export class Points {
  constructor(rows, column, scale, period) {
    Object.assign(this, { rows, column, scale, gap: GAP_ROWS * period });
  }

  take() {}

  from(column) { return Math.max(this.rows.find(column / this.scale) - ROWS_BEFORE, this.rows.first); }
  upTo(column) { return Math.min(this.rows.find(column / this.scale) + 1, this.rows.count); }

  spread(first, end, range) {
    const values = this.rows.values[this.column], last = this.upTo(end);
    for (let row = this.from(first); row < last; row++) {
      const value = values[row & MASK];
      if (value < range[0]) range[0] = value;
      if (value > range[1]) range[1] = value;
    }
  }

  trace(pen, first, end, x0, yOf) {
    const { rows: { time }, scale, gap } = this, values = this.rows.values[this.column], last = this.upTo(end);
    let before = -Infinity;
    for (let row = this.from(first); row < last; row++) {
      const at = row & MASK, value = values[at];
      if (value !== value) continue;
      const x = x0 + time[at] * scale, y = yOf(value);
      if (time[at] - before > gap) pen.moveTo(x, y);
      pen.lineTo(x, y);
      before = time[at];
    }
  }
}
