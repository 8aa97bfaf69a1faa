// Plots of the signals: the rows that came, and panels with a common time axis, one for each unit.
// A pixel column shows the least and the greatest value in it, so that no spike is lost.

const KEPT = 1 << 15;
const COLOURS = ["#2a5ca8", "#b3261e", "#b08600", "#1a8f7a", "#8a63d2", "#c2578f", "#4f7d1f", "#7a6a58"];
const LEFT = 58, RIGHT = 8, TOP = 6, BOTTOM = 20;
const LIVE_SPAN_S = 30, SHORTEST_SPAN_S = 0.02;

// The newest rows of one run, in rings of a power of two.
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
    const [tick, run, , rows, columns, missed] = new Uint32Array(buffer, 0, 6);
    if (run !== this.run || columns !== this.values.length) this.reset(run, columns);
    this.missed += missed;
    const time = new Float64Array(buffer, 24, rows), values = new Float32Array(buffer, 24 + 8 * rows, rows * columns);
    for (let row = 0; row < rows; row++, this.count++) {
      const at = this.count & (KEPT - 1);
      this.time[at] = time[row];
      for (let column = 0; column < columns; column++) this.values[column][at] = values[row * columns + column];
    }
    return tick;
  }

  get first() { return Math.max(0, this.count - KEPT); }
  get newest() { return this.count ? this.time[(this.count - 1) & (KEPT - 1)] : 0; }
  get oldest() { return this.count ? this.time[this.first & (KEPT - 1)] : 0; }
  last(column) { return this.count ? this.values[column][(this.count - 1) & (KEPT - 1)] : NaN; }

  // The number of the first row at or after a time.
  find(time) {
    let low = this.first, high = this.count;
    while (low < high) {
      const middle = (low + high) >>> 1;
      if (this.time[middle & (KEPT - 1)] < time) low = middle + 1; else high = middle;
    }
    return low;
  }
}

// The stretch of time that every panel shows. end: null follows the newest row.
export class View {
  constructor(rows) { this.rows = rows; this.live(); this.cursor = null; }
  live() { this.end = null; this.span = LIVE_SPAN_S; }
  get right() { return this.end === null ? Math.max(this.rows.newest, this.span) : this.end; }
  get left() { return this.right - this.span; }
  pause() { this.end = this.end === null ? this.right : null; }
  show(left, right) {
    this.span = Math.min(Math.max(right - left, SHORTEST_SPAN_S), 2 * LIVE_SPAN_S + 10);
    this.end = left + this.span;
  }
  zoom(factor, about) {
    const live = this.end === null && about === undefined, at = about ?? this.right;
    const left = at - (at - this.left) * factor, right = at + (this.right - at) * factor;
    this.show(left, right);
    if (live) this.end = null;
  }
  pan(part) { this.show(this.left + part * this.span, this.right + part * this.span); }
}

function ticks(low, high, wanted) {
  const rough = (high - low) / wanted, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((n) => n * power).find((n) => n >= rough) ?? 10 * power;
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + step * 1e-9; at += step) found.push(at);
  return [found, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))];
}

/** A number with so many places; a value that rounds to zero has no sign. */
export function fixed(value, places) {
  return (Number(value.toFixed(places)) + 0).toFixed(places);
}

export function shown(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  return fixed(value, size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : 3);
}

// One canvas with the signals of a unit. signals: [{name, column, colour, on}].
export class Panel {
  constructor(title, signals, rows, view) {
    Object.assign(this, { title, signals, rows, view });
    this.element = document.createElement("div");
    this.element.className = "panel";
    const keys = document.createElement("div");
    keys.className = "keys";
    const heading = document.createElement("b");
    heading.textContent = title;
    keys.append(heading, ...signals.map((signal) => this.key(signal)));
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${title}: ${signals.map((signal) => signal.name).join(", ")}`);
    this.element.append(keys, this.canvas);
    this.listen();
  }

  key(signal) {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "key";
    const swatch = document.createElement("canvas");
    swatch.width = swatch.height = 1;
    const pen = swatch.getContext("2d");
    pen.fillStyle = signal.colour;
    pen.fillRect(0, 0, 1, 1);
    signal.output = document.createElement("output");
    button.append(swatch, signal.name, signal.output);
    const mark = () => button.setAttribute("aria-pressed", String(signal.on));
    button.addEventListener("click", () => { signal.on = !signal.on; mark(); });
    mark();
    return button;
  }

  timeAt(event) {
    const box = this.canvas.getBoundingClientRect();
    const part = (event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT);
    return this.view.left + Math.min(Math.max(part, 0), 1) * this.view.span;
  }

  listen() {
    let from = null;
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => {
      from = this.timeAt(event);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      this.view.cursor = this.timeAt(event);
      this.view.brush = from === null ? null : [from, this.view.cursor];
    });
    canvas.addEventListener("pointerup", (event) => {
      const to = this.timeAt(event);
      if (from !== null && Math.abs(to - from) > 0.01 * this.view.span) {
        this.view.show(Math.min(from, to), Math.max(from, to));
      }
      from = this.view.brush = null;
    });
    canvas.addEventListener("pointercancel", () => { from = this.view.brush = null; });
    canvas.addEventListener("pointerleave", () => { this.view.cursor = null; });
    canvas.addEventListener("dblclick", () => this.view.live());
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      this.view.zoom(event.deltaY > 0 ? 1.25 : 0.8, this.timeAt(event));
    }, { passive: false });
  }

  // Least and greatest value of a column in each pixel column, and the range of all.
  extremes(column, first, end, left, scale, width) {
    const low = new Float32Array(width).fill(Infinity), high = new Float32Array(width).fill(-Infinity);
    const times = this.rows.time, values = this.rows.values[column];
    for (let row = first; row < end; row++) {
      const at = row & (KEPT - 1), value = values[at];
      if (value !== value) continue;
      const x = Math.min(Math.max(((times[at] - left) * scale) | 0, 0), width - 1);
      if (value < low[x]) low[x] = value;
      if (value > high[x]) high[x] = value;
    }
    return [low, high];
  }

  draw(style) {
    const ratio = window.devicePixelRatio || 1, box = this.canvas.getBoundingClientRect();
    const wide = Math.round(box.width * ratio), tall = Math.round(box.height * ratio);
    if (!wide || !tall) return;
    if (this.canvas.width !== wide || this.canvas.height !== tall) Object.assign(this.canvas, { width: wide, height: tall });
    const pen = this.canvas.getContext("2d");
    const x0 = LEFT * ratio, y0 = TOP * ratio, width = Math.max(1, Math.round(wide - (LEFT + RIGHT) * ratio));
    const height = tall - (TOP + BOTTOM) * ratio, { left, span } = this.view;
    const first = Math.max(this.rows.first, this.rows.find(left) - 1);
    const end = Math.min(this.rows.count, this.rows.find(left + span) + 1);
    const drawn = this.signals.filter((signal) => signal.on)
      .map((signal) => [signal, ...this.extremes(signal.column, first, end, left, width / span, width)]);
    const [bottom, top] = this.range(drawn);
    const yOf = (value) => y0 + height * (top - value) / (top - bottom);
    pen.clearRect(0, 0, wide, tall);
    this.grid(pen, style, ratio, { x0, y0, width, height, bottom, top, yOf });
    pen.save();
    pen.beginPath();
    pen.rect(x0, y0, width, height);
    pen.clip();
    for (const [signal, low, high] of drawn.reverse()) this.line(pen, ratio, x0, yOf, signal.colour, low, high);
    pen.restore();
    this.marks(pen, style, ratio, x0, y0, width, height);
  }

  range(drawn) {
    let low = Infinity, high = -Infinity;
    for (const [, lows, highs] of drawn) {
      for (let x = 0; x < lows.length; x++) {
        if (lows[x] < low) low = lows[x];
        if (highs[x] > high) high = highs[x];
      }
    }
    if (low > high) return [-1, 1];
    const room = Math.max((high - low) * 0.06, Math.abs(high) * 1e-4, 1e-3);
    return [low - room, high + room];
  }

  line(pen, ratio, x0, yOf, colour, low, high) {
    pen.strokeStyle = colour;
    pen.lineWidth = 1.4 * ratio;
    pen.lineJoin = "round";
    pen.beginPath();
    let drawing = false, gap = 0;
    for (let x = 0; x < low.length; x++) {
      if (low[x] > high[x]) { gap++; continue; }
      if (!drawing) pen.moveTo(x0 + x, yOf(high[x]));
      pen.lineTo(x0 + x, yOf(high[x]));
      if (low[x] < high[x]) pen.lineTo(x0 + x, yOf(low[x]));
      drawing = true;
      gap = 0;
    }
    pen.stroke();
  }

  grid(pen, style, ratio, { x0, y0, width, height, bottom, top, yOf }) {
    pen.font = `${11 * ratio}px system-ui, sans-serif`;
    pen.lineWidth = ratio;
    pen.strokeStyle = style.rule;
    pen.fillStyle = style.soft;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    const [values, places] = ticks(bottom, top, 5);
    pen.beginPath();
    for (const value of values) {
      pen.moveTo(x0, yOf(value));
      pen.lineTo(x0 + width, yOf(value));
      pen.fillText((Math.abs(value) < 1e-12 ? 0 : value).toFixed(places), x0 - 6 * ratio, yOf(value));
    }
    pen.textBaseline = "top";
    pen.textAlign = "center";
    const { left, span } = this.view, [times, timePlaces] = ticks(left, left + span, Math.max(2, width / ratio / 90));
    for (const time of times) {
      const x = x0 + width * (time - left) / span;
      pen.moveTo(x, y0);
      pen.lineTo(x, y0 + height);
      if (x < x0 + width - 14 * ratio) pen.fillText(`${time.toFixed(timePlaces)} s`, x, y0 + height + 5 * ratio);
    }
    pen.stroke();
  }

  // The stretch that is being dragged over, the cursor, and the values in the keys.
  marks(pen, style, ratio, x0, y0, width, height) {
    const { left, span, cursor, brush } = this.view;
    const xOf = (time) => x0 + width * (time - left) / span;
    if (brush) {
      pen.fillStyle = `${style.line}33`;
      pen.fillRect(xOf(brush[0]), y0, xOf(brush[1]) - xOf(brush[0]), height);
    }
    if (cursor !== null) {
      pen.strokeStyle = style.soft;
      pen.setLineDash([3 * ratio, 3 * ratio]);
      pen.beginPath();
      pen.moveTo(xOf(cursor), y0);
      pen.lineTo(xOf(cursor), y0 + height);
      pen.stroke();
      pen.setLineDash([]);
    }
    const row = cursor === null ? this.rows.count - 1 : Math.min(this.rows.find(cursor), this.rows.count - 1);
    for (const signal of this.signals) {
      signal.output.textContent = row < 0 ? "–" : shown(this.rows.values[signal.column][row & (KEPT - 1)]);
    }
  }
}

const FIRST = ["quaternion", "deg", "deg/s", "m/s"], LAST = ["count"];
const rank = (title) => (FIRST.includes(title) ? FIRST.indexOf(title) : LAST.includes(title) ? 99 : 50);

// Panels for the columns of a run: one for each unit, and one for each signal without a unit; the attitude first.
export function panelsOf(columns, rows, view) {
  const groups = new Map();
  columns.forEach(({ name, unit }, column) => {
    const quaternion = /^[wxyz]$/.test(name), title = unit || (quaternion ? "quaternion" : name);
    if (!groups.has(title)) groups.set(title, []);
    const of = groups.get(title);
    of.push({ name, column, colour: COLOURS[of.length % COLOURS.length], on: true });
  });
  return [...groups].sort(([a], [b]) => rank(a) - rank(b)).map(([title, signals]) => new Panel(title, signals, rows, view));
}
