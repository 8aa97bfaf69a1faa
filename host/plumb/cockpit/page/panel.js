// One plot: a canvas with the signals of a unit.
//
// The picture moves to the left by whole pixels as time passes, and only what is new is drawn. Everything is drawn
// anew when the view, the size, the range of the values, the colours or the chosen lines change.

import { Columns, Points, dense } from "./columns.js";
import { MASK } from "./rows.js";
import { fixed, placesOf, rangeFor, tickStep } from "./scale.js";

export const LEFT = 58, RIGHT = 8;
const TOP = 6, BOTTOM = 22, FONT_PX = 11, LINE_PX = 1.4, TICK_PX = 90;
const resized = new ResizeObserver((entries) => { for (const { target } of entries) target.panel.measure(); });
const scrolled = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) target.panel.seen = isIntersecting;
});

const firstTick = ({ bottom, step }) => Math.ceil(bottom / step - 1e-9) * step;

// signals: [{column, colour, on}]; colour: its number among those of the style. least: the least height in the unit.
export class Panel {
  constructor(canvas, signals, rows, view, least) {
    Object.assign(this, { canvas, signals, rows, view, least, seen: true, whole: true, range: null, scale: 0, end: 0 });
    this.pen = canvas.getContext("2d", { alpha: false });
    this.extent = [0, 0];
    this.yOf = (value) => this.y0 + this.height * (this.range.top - value) / (this.range.top - this.range.bottom);
    canvas.panel = this;
    this.measure();
    resized.observe(canvas);
    scrolled.observe(canvas);
  }

  // Takes the size of the canvas on the screen; everything is drawn anew.
  measure() {
    const ratio = window.devicePixelRatio || 1, wide = Math.round(this.canvas.clientWidth * ratio);
    const tall = Math.round(this.canvas.clientHeight * ratio);
    Object.assign(this.canvas, { width: Math.max(wide, 1), height: Math.max(tall, 1) });
    this.ratio = ratio;
    this.x0 = Math.round(LEFT * ratio);
    this.y0 = Math.round(TOP * ratio);
    this.width = wide - this.x0 - Math.round(RIGHT * ratio);
    this.height = tall - this.y0 - Math.round(BOTTOM * ratio);
    this.whole = true;
    if (this.style) this.draw(this.style, this.period);
  }

  // Draws what is new. style: colours; period: of a step of the run, s.
  draw(style, period) {
    if (style !== this.style) Object.assign(this, { style, whole: true });
    this.period = period;
    if (!this.seen || this.width < 1 || this.height < 1) return;
    const { rows, view } = this, scale = this.width / view.span, live = view.end === null;
    const follows = live && rows.newest > view.span;
    const right = follows ? Math.floor(rows.newest * scale) + 1 : Math.round(view.right * scale), left = right - this.width;
    if (scale !== this.scale || rows.run !== this.run || left < this.left || this.end < rows.first) this.renew(scale);
    const end = this.endOf(live, view.right);
    if (!this.whole && left === this.left && end === this.end) return;
    const drawn = Math.floor(rows.time[(this.end - 1) & MASK] * scale) - 1, shift = left - this.left;
    const first = Math.max(rows.find(left / scale) - 1, rows.first);
    for (const { line } of this.signals) line.take(first, end);
    const range = this.rangeOf(left, right);
    const whole = this.whole || range !== this.range || shift >= this.width;
    Object.assign(this, { left, end, range, whole: false });
    if (whole) this.drawAll();
    else this.drawNew(shift, Math.max(drawn, left));
  }

  // The number after the last row of the view; a view of the past that is not kept any more stays as it is.
  endOf(live, right) {
    if (live) return this.rows.count;
    return right < this.rows.oldest ? this.end : Math.min(this.rows.find(right) + 1, this.rows.count);
  }

  // Begins anew: another run, another scale, or a time before the one that is shown.
  renew(scale) {
    const { period } = this;
    Object.assign(this, { scale, run: this.rows.run, left: 0, end: 0, whole: true });
    for (const signal of this.signals) {
      signal.line = dense(scale, period) ? new Columns(this.rows, signal.column, this.width, scale)
        : new Points(this.rows, signal.column, scale, period);
    }
  }

  rangeOf(left, right) {
    const extent = this.extent;
    extent[0] = Infinity;
    extent[1] = -Infinity;
    for (const { line, on } of this.signals) if (on) line.spread(left, right, extent);
    return rangeFor(extent[0], extent[1], this.range, this.least);
  }

  drawAll() {
    const { pen, canvas, style } = this;
    pen.fillStyle = style.ground;
    pen.fillRect(0, 0, canvas.width, canvas.height);
    this.valueTicks();
    this.part(this.left);
    this.timeTicks(this.left, this.left + this.width);
  }

  drawNew(shift, from) {
    const { pen, canvas, x0, width, style, ratio } = this, tall = canvas.height;
    const strip = this.y0 + this.height + Math.ceil(FONT_PX * ratio / 2);
    if (shift > 0) {
      pen.drawImage(canvas, x0 + shift, 0, width - shift, tall, x0, 0, width - shift, tall);
      pen.fillStyle = style.ground;
      pen.fillRect(0, strip, x0, tall - strip);
      pen.fillRect(x0 + width - shift, strip, canvas.width, tall - strip);
    }
    this.part(from);
    if (shift > 0) this.timeTicks(this.left + width - shift, this.left + width);
  }

  // The plot from a column on, to its right end.
  part(from) {
    const { pen, x0, y0, width, height, ratio, left, style } = this, x = x0 + from - left;
    pen.save();
    pen.beginPath();
    pen.rect(x, y0 - ratio, x0 + width - x, height + 2 * ratio);
    pen.clip();
    pen.fillStyle = style.ground;
    pen.fillRect(x, 0, x0 + width - x, y0 + height + 2 * ratio);
    this.lattice(x, from);
    pen.lineWidth = LINE_PX * ratio;
    pen.lineJoin = pen.lineCap = "round";
    for (let index = this.signals.length - 1; index >= 0; index--) {
      const { line, on, colour } = this.signals[index];
      if (!on) continue;
      pen.strokeStyle = style.colours[colour];
      pen.beginPath();
      line.trace(pen, from, left + width, x0 - left, this.yOf);
      pen.stroke();
    }
    pen.restore();
  }

  // The lines of the ticks, from x on.
  lattice(x, from) {
    const { pen, x0, y0, width, height, ratio, left, range } = this;
    pen.fillStyle = this.style.rule;
    for (let value = firstTick(range); value <= range.top + range.step / 9; value += range.step) {
      pen.fillRect(x, Math.round(this.yOf(value)), x0 + width - x, ratio);
    }
    const step = this.timeStep;
    for (let index = Math.ceil(from / this.scale / step); index * step * this.scale < left + width; index++) {
      pen.fillRect(x0 + Math.floor(index * step * this.scale) - left, y0, ratio, height);
    }
  }

  get timeStep() { return tickStep(TICK_PX * this.ratio / this.scale); }

  write(align, baseline) {
    const { pen } = this;
    pen.font = `${FONT_PX * this.ratio}px system-ui, sans-serif`;
    pen.fillStyle = this.style.soft;
    pen.textAlign = align;
    pen.textBaseline = baseline;
  }

  valueTicks() {
    const { pen, x0, ratio, range } = this, places = placesOf(range.step);
    this.write("right", "middle");
    for (let value = firstTick(range); value <= range.top + range.step / 9; value += range.step) {
      pen.fillText(fixed(value, places), x0 - 6 * ratio, this.yOf(value));
    }
  }

  // The times whose text came to stand wholly within the plot as its right end moved from column `from` to `to`.
  timeTicks(from, to) {
    const { pen, x0, y0, height, ratio, left, scale, timeStep: step } = this, places = placesOf(step);
    const half = TICK_PX * ratio / 3, whole = from === left;
    this.write("center", "top");
    for (let index = Math.max(0, Math.floor((from - half) / scale / step)); index * step * scale <= to; index++) {
      const column = Math.floor(index * step * scale);
      if (column + half > to || (!whole && column + half <= from) || column < left) continue;
      pen.fillText(`${fixed(index * step, places)} s`, x0 + column - left, y0 + height + 6 * ratio);
    }
  }
}
