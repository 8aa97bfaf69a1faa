// The stretch of time that every plot shows, and the cursor in it.

const LIVE_SPAN_S = 30, SHORTEST_SPAN_S = 0.02, LONGEST_SPAN_S = 65;

// end: null follows the newest row. cursor, brush: parts of the width, null without.
export class View {
  constructor(rows) {
    this.rows = rows;
    this.cursor = this.brush = null;
    this.live();
  }

  live() { this.end = null; this.span = LIVE_SPAN_S; }
  get right() { return this.end === null ? Math.max(this.rows.newest, this.span) : this.end; }
  get left() { return this.right - this.span; }
  timeAt(part) { return this.left + part * this.span; }
  pause() { this.end = this.end === null ? this.right : null; }

  show(left, right) {
    this.span = Math.min(Math.max(right - left, SHORTEST_SPAN_S), LONGEST_SPAN_S);
    this.end = left + this.span;
  }

  // Wider or narrower by a factor about a time; without one a live view stays live.
  zoom(factor, about) {
    const live = this.end === null && about === undefined, at = about ?? this.right;
    this.show(at - (at - this.left) * factor, at + (this.right - at) * factor);
    if (live) this.end = null;
  }

  pan(part) {
    const end = Math.max(this.right + part * this.span, this.rows.oldest + this.span);
    this.end = end >= this.rows.newest ? null : end;
  }
}
