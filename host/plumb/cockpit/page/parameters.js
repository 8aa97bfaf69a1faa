// The parameters of the board: a row for each, which opens to its meaning, limits, a slider and a field.

import { byId, element, setText } from "./dom.js";

const STEPS = 200, REACH = 4;

// The stretch of a slider: a quarter to four times the value, within the limits.
function stretch(value, [least, most]) {
  let [low, high] = value ? [value / REACH, value * REACH].sort((a, b) => a - b) : [-1, 1];
  if (least !== null) low = Math.max(low, least);
  if (most !== null) high = Math.min(high, most);
  return [low, high];
}

const shown = (value) => (typeof value === "number" ? String(Number(value.toPrecision(6))) : value);

// What a write does now.
function ruleOf(said) {
  if (!said.may_control || !said.holds) return "Only the page that holds the board reads and writes them.";
  if (said.watch) return "The cockpit was started with --watch: it writes nothing.";
  if (said.armed_here) {
    return "Armed: a gain marked live changes at once, at most to half or twice its value at arming. "
      + "Everything else is locked until the board is disarmed.";
  }
  if (said.armed) return "Armed by another program or by the arm switch: locked.";
  return "A gain marked live changes while the run goes on; any other write begins a new run. "
    + "The board keeps a value until its reset, or until it is saved.";
}

export class ParameterList {
  // order: sends an order, and calls back with its answer.
  constructor(place, order) {
    Object.assign(this, { place, order, mode: "" });
  }

  // Opened rows show other limits once the board is armed or disarmed.
  showState(said) {
    setText(byId("rule"), ruleOf(said));
    const mode = `${said.armed} ${said.armed_here} ${said.holds}`;
    if (mode === this.mode) return;
    this.mode = mode;
    for (const row of this.place.children) if (row.childElementCount > 1) this.open(row);
  }

  show(parameters) {
    this.place.replaceChildren(...parameters.map(({ name, value, live }) => this.row(name, value, live)));
    this.filter(byId("filter").value);
  }

  row(name, value, live) {
    const output = element("output", "", shown(value)), button = element("button", "", name);
    if (live) button.append(element("span", "live", "live"));
    button.append(output);
    button.type = "button";
    button.setAttribute("aria-expanded", "false");
    const row = element("div", "parameter", button);
    row.dataset.name = name;
    button.addEventListener("click", () => (row.childElementCount > 1 ? this.close(row) : this.open(row)));
    return row;
  }

  close(row) {
    row.lastElementChild.remove();
    row.firstElementChild.setAttribute("aria-expanded", "false");
  }

  open(row) {
    this.order({ do: "describe", name: row.dataset.name }, (said) => {
      if (!said.good) return;
      const used = row.contains(document.activeElement) ? document.activeElement.type : "";
      if (row.childElementCount > 1) row.lastElementChild.remove();
      row.append(this.editor(row, said.parameter));
      row.querySelector(`input[type="${used}"]`)?.focus();
      row.firstElementChild.setAttribute("aria-expanded", "true");
      setText(row.querySelector("output"), shown(said.parameter.value));
    });
  }

  editor(row, { unit, value, limits, meaning, locked }) {
    const { name } = row.dataset, number = typeof value === "number", field = element("input"), set = element("button", "", "Set");
    const [least, most] = limits.map((limit) => (limit === null ? "no limit" : shown(limit)));
    set.type = "button";
    field.type = number ? "number" : "text";
    if (number) field.step = "any";
    field.value = shown(value);
    field.setAttribute("aria-label", name);
    field.disabled = set.disabled = Boolean(locked);
    set.addEventListener("click", () => this.set(row, number ? Number(field.value) : field.value));
    field.addEventListener("keydown", (event) => { if (event.key === "Enter") set.click(); });
    const unitShown = unit === "1" || unit === "choice" ? "" : unit;
    const place = element("div", "", element("p", "note", number ? `${meaning}. ${least} to ${most} ${unitShown}` : meaning));
    if (locked) place.append(element("p", "note", locked));
    place.append(element("p", "row", field, unitShown, set));
    if (number && !locked) place.append(this.slider(row, value, limits, field));
    return place;
  }

  slider(row, value, limits, field) {
    const range = element("input"), [low, high] = stretch(value, limits);
    const whole = Number.isInteger(value) && limits.every(Number.isInteger);
    Object.assign(range, { type: "range", min: low, max: high, step: whole ? 1 : (high - low) / STEPS, value });
    range.setAttribute("aria-label", `${row.dataset.name}, slider`);
    range.addEventListener("input", () => { field.value = shown(Number(range.value)); });
    range.addEventListener("change", () => this.set(row, Number(range.value)));
    return range;
  }

  set(row, value) {
    this.order({ do: "set", name: row.dataset.name, value }, (said) => {
      if (said.good) row.querySelector("output").className = "changed";
      this.open(row);
    });
  }

  filter(text) {
    for (const row of this.place.children) row.hidden = !row.dataset.name.includes(text);
  }
}
