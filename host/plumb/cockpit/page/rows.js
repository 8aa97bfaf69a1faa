// The newest rows of one run, in rings of a power of two, as the server sends them.

export const KEPT = 1 << 15, MASK = KEPT - 1;
const HEADER_WORDS = 6;

export class Rows {
  constructor() { this.reset(0, 0); }

  reset(run, columns) {
    this.run = run;
    this.count = 0;
    this.missed = 0;
    this.time = new Float64Array(KEPT);
    this.values = Array.from({ length: columns }, () => new Float32Array(KEPT));
  }

  // Takes a message of the server; returns its tick.
  push(buffer) {
    const [tick, run, , rows, columns, missed] = new Uint32Array(buffer, 0, HEADER_WORDS);
    if (run !== this.run || columns !== this.values.length) this.reset(run, columns);
    this.missed += missed;
    const time = new Float64Array(buffer, 4 * HEADER_WORDS, rows);
    const values = new Float32Array(buffer, 4 * HEADER_WORDS + 8 * rows, rows * columns);
    for (let row = 0; row < rows; row++) this.time[(this.count + row) & MASK] = time[row];
    for (let column = 0; column < columns; column++) {
      const ring = this.values[column];
      for (let row = 0; row < rows; row++) ring[(this.count + row) & MASK] = values[row * columns + column];
    }
    this.count += rows;
    return tick;
  }

  get first() { return Math.max(0, this.count - KEPT); }
  get newest() { return this.count ? this.time[(this.count - 1) & MASK] : 0; }
  get oldest() { return this.count ? this.time[this.first & MASK] : 0; }
  last(column) { return this.count ? this.values[column][(this.count - 1) & MASK] : NaN; }

  // The number of the first row at or after a time.
  find(time) {
    let low = this.first, high = this.count;
    while (low < high) {
      const middle = (low + high) >>> 1;
      if (this.time[middle & MASK] < time) low = middle + 1; else high = middle;
    }
    return low;
  }
}
