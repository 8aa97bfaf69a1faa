// The plots of a run: one for each unit, with the names and values of its signals above it, a cursor and a brush.

import { MASK } from "./rows.js";
import { element } from "./dom.js";
import { LEFT, Panel, RIGHT } from "./panel.js";
import { shown } from "./scale.js";

const COLOURS = 8, SMALLEST_BRUSH = 0.01;
const COMMANDS = "commands of the pilot", MOTORS = "motors";
const QUANTITIES = { deg: "Angle", "deg/s": "Rate", us: "Pulse width", "m/s": "Speed", count: "Raw reading" };
const FIRST = ["deg", "deg/s", "m/s", "us", MOTORS, COMMANDS], LAST = ["quaternion", "count"];
// Least height of a plot in its unit: what does not move is a flat line, and its noise is no mountain.
const LEAST = { deg: 0.1, "deg/s": 0.2, us: 10, "m/s": 0.05, count: 10 }, LEAST_SHARE = 0.1;

export class Plot {
  constructor(title, signals, rows, view) {
    Object.assign(this, { title, signals, rows, view, from: null });
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${title}: ${signals.map((signal) => signal.name).join(", ")}`);
    this.cursor = element("i", "cursor");
    this.brush = element("i", "brush");
    this.cursor.hidden = this.brush.hidden = true;
    const heading = element("b", "", QUANTITIES[title] ?? title[0].toUpperCase() + title.slice(1));
    if (QUANTITIES[title]) heading.append(element("small", "", ` ${title}`));
    this.idle = element("small", "idle", " asked for, and not driven: the board is disarmed");
    this.idle.hidden = true;
    if (signals.some((signal) => signal.drives)) heading.append(this.idle);
    this.element = element("div", "panel", element("div", "keys", heading, ...signals.map((signal) => this.key(signal))),
      element("div", "screen", this.canvas, this.brush, this.cursor));
    this.panel = new Panel(this.canvas, signals, rows, view, LEAST[title] ?? LEAST_SHARE);
    this.listen();
  }

  key(signal) {
    signal.output = document.createElement("output");
    const swatch = element("i", `swatch colour-${signal.colour}`);
    const button = element("button", "key", swatch, signal.name, signal.output);
    button.type = "button";
    button.title = "show or hide the line";
    const mark = () => button.setAttribute("aria-pressed", String(signal.on));
    button.addEventListener("click", () => { signal.on = !signal.on; this.panel.whole = true; mark(); });
    mark();
    return button;
  }

  partAt(event) {
    const box = this.canvas.getBoundingClientRect();
    return Math.min(Math.max((event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT), 0), 1);
  }

  listen() {
    const { canvas, view } = this;
    canvas.addEventListener("pointerdown", (event) => {
      this.from = this.partAt(event);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      view.cursor = this.partAt(event);
      view.brush = this.from === null ? null : [Math.min(this.from, view.cursor), Math.max(this.from, view.cursor)];
    });
    canvas.addEventListener("pointerup", (event) => {
      const to = this.partAt(event), from = this.from;
      this.from = view.brush = null;
      if (from === null || Math.abs(to - from) < SMALLEST_BRUSH) return;
      view.show(view.timeAt(Math.min(from, to)), view.timeAt(Math.max(from, to)));
    });
    canvas.addEventListener("pointercancel", () => { this.from = view.brush = null; });
    canvas.addEventListener("pointerleave", () => { view.cursor = null; });
    canvas.addEventListener("dblclick", () => view.live());
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      view.zoom(event.deltaY > 0 ? 1.25 : 0.8, view.timeAt(this.partAt(event)));
    }, { passive: false });
  }

  // Cursor and brush where the view has them.
  mark() {
    const { view: { cursor, brush }, cursor: line, brush: stretch } = this, width = this.canvas.clientWidth - LEFT - RIGHT;
    line.hidden = cursor === null;
    if (cursor !== null) line.style.transform = `translateX(${LEFT + cursor * width}px)`;
    stretch.hidden = brush === null;
    if (brush === null) return;
    stretch.style.transform = `translateX(${LEFT + brush[0] * width}px)`;
    stretch.style.width = `${(brush[1] - brush[0]) * width}px`;
  }

  showArmed(armed) { this.idle.hidden = armed; }

  // The values of a row, next to the names; -1: none.
  showValues(row) {
    for (const { output, column } of this.signals) {
      const text = row < 0 ? "–" : shown(this.rows.values[column][row & MASK]);
      if (output.textContent !== text) output.textContent = text;
    }
  }
}

const rank = (title) => (FIRST.includes(title) ? FIRST.indexOf(title) : LAST.includes(title) ? 90 + LAST.indexOf(title) : 50);

// Plots for the columns of a run: one for each unit, one for the pilot's commands, and one for each other signal without
// a unit; the angles first.
export function plotsOf(columns, rows, view) {
  const groups = new Map();
  columns.forEach(({ name, unit, drives }, column) => {
    const kind = /^[wxyz]$/.test(name) ? "quaternion" : name.startsWith("command_") ? COMMANDS : drives ? MOTORS : name;
    const title = unit || kind;
    if (!groups.has(title)) groups.set(title, []);
    const of = groups.get(title);
    of.push({ name, column, drives, colour: of.length % COLOURS, on: true });
  });
  return [...groups].sort(([a], [b]) => rank(a) - rank(b)).map(([title, signals]) => new Plot(title, signals, rows, view));
}
