// The page of the cockpit: what is shown of a state and when it is drawn, and what is pressed.

import { anglesOf, attitudeOf, drawBody, drawHorizon } from "./attitude.js";
import { setpointMoved, showControl } from "./control.js";
import { byId, setText } from "./dom.js";
import { showAnswer, showHealth, showLog } from "./health.js";
import { gone, showLight, trouble } from "./light.js";
import { Link } from "./link.js";
import { ParameterList } from "./parameters.js";
import { plotsOf } from "./plots.js";
import { Rows } from "./rows.js";
import { fixed } from "./scale.js";
import { View } from "./view.js";

const FRAME_MS = 1000 / 30, EARLY_MS = 4, COLOURS = 8, MARGIN_S = 0.5;
const rows = new Rows(), view = new View(rows);
let state = null, run = null, plots = [], shownColumns = "", style = {}, drawnAt = 0, attitudeDrawn = "", cursorDrawn = "";

// The page that holds the board is its dead man's handle: a hidden page is a hand off it.
const link = new Link(rows, { received: showState, answered: showAnswer, silent, alive: () => state?.holds && !document.hidden });
const parameters = new ParameterList(byId("rows"), (what, then) => link.order(what, then));

function stop() { link.send({ do: "stop" }); }

addEventListener("keydown", (event) => {
  if (event.key === " " || event.key === "Escape") {
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) stop();
  }
}, { capture: true });
addEventListener("keyup", (event) => {  // a button that has the focus is pressed when Space comes up
  if (event.key === " ") { event.preventDefault(); event.stopPropagation(); }
}, { capture: true });
byId("stop").addEventListener("click", stop);

// ---- what is shown ----

function silent() {
  state = null;
  gone("plumb cockpit does not answer: it has ended, or hangs. The board is disarmed without it.");
  document.body.className = "stale";
  byId("armed").className = "unknown";
  setText(byId("armed"), "unknown");
}

function slowText(speed) {
  return `The simulated board runs at ${speed.toPrecision(2)} of real time: end other programs on its machine, `
    + "or serve it with plumb virtual-board --port native, which takes less work.";
}

function showState(said) {
  state = said;
  run = said.run ?? null;
  document.querySelector("aside").inert = false;
  if (!said.light) { trouble("waiting for the board"); return; }
  document.body.className = said.lost ? "stale" : "";
  trouble(said.lost ? `${said.lost}. The cockpit tries to open the board again.` : said.mismatch);
  setText(byId("slow"), said.speed < 0.9 ? slowText(said.speed) : "");
  setText(byId("system"), `${said.run?.system ?? ""} on ${said.board}`);
  showLight(said.light);
  byId("armed").className = said.armed ? "armed" : "disarmed";
  setText(byId("armed"), said.armed ? (said.armed_here ? "ARMED" : "ARMED elsewhere") : said.arming ? "arming" : "disarmed");
  showPlots(said.run?.columns ?? []);
  for (const plot of plots) plot.showArmed(said.armed);
  showControl(said);
  parameters.showState(said);
  showHealth(said);
  showLog(said.notes);
  showValues();
  setText(byId("missed"), rows.missed ? `${rows.missed} rows were not drawn: this page is slow. A recording has them.` : "");
}

function showPlots(columns) {
  const key = JSON.stringify(columns);
  if (key === shownColumns) return;
  shownColumns = key;
  plots = plotsOf(columns, rows, view);
  byId("empty").hidden = plots.length > 0;
  byId("panels").style.setProperty("--count", Math.max(plots.length, 1));
  byId("panels").replaceChildren(...plots.map((plot) => plot.element));
  cursorDrawn = "";
}

// The values at the cursor, or the newest.
function showValues() {
  const at = view.cursor === null ? rows.count - 1 : Math.min(rows.find(view.timeAt(view.cursor)), rows.count - 1);
  for (const plot of plots) plot.showValues(at);
  setText(byId("cursor-time"), view.cursor === null ? "" : `at ${fixed(view.timeAt(view.cursor), 3)} s`);
  byId("newest").value = rows.newest;
  const paused = String(view.end !== null), button = document.querySelector("[data-act=pause]");
  if (button.getAttribute("aria-pressed") !== paused) button.setAttribute("aria-pressed", paused);
}

// ---- what is drawn ----

function readStyle() {
  const of = getComputedStyle(document.documentElement), value = (name) => of.getPropertyValue(`--${name}`).trim();
  style = Object.fromEntries(["ground", "text", "soft", "rule", "panel", "sky", "earth"].map((name) => [name, value(name)]));
  style.colours = Array.from({ length: COLOURS }, (_, index) => value(`colour-${index}`));
  attitudeDrawn = "";
}
readStyle();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", readStyle);
addEventListener("resize", () => { attitudeDrawn = cursorDrawn = ""; });

// Thirty times a second: what is new in the plots, and the attitude when it changed. Texts change with the state.
function draw(now) {
  requestAnimationFrame(draw);
  if (now - drawnAt < FRAME_MS - EARLY_MS) return;
  drawnAt = now;
  if (run?.number === rows.run) for (const { panel } of plots) panel.draw(style, run.period_s);
  markCursor();
  drawAttitude();
  link.drawn();
}

function markCursor() {
  const key = `${view.cursor} ${view.brush}`;
  if (key === cursorDrawn) return;
  cursorDrawn = key;
  for (const plot of plots) plot.mark();
  showValues();
}

function drawAttitude() {
  const attitude = state?.run ? attitudeOf(rows, run.columns, state.tilt_about) : null;
  const key = attitude ? attitude.quaternion.map((part) => part.toFixed(4)).join() : "none";
  if (key === attitudeDrawn) return;
  attitudeDrawn = key;
  drawHorizon(byId("horizon"), attitude, style);
  drawBody(byId("body"), attitude, style);
  const [roll, pitch, yaw] = attitude ? anglesOf(attitude.quaternion).map((angle) => `${fixed(angle, 1)}°`) : [];
  setText(byId("angles"), attitude ? `roll ${roll}   pitch ${pitch}${attitude.yaw ? `   yaw ${yaw}` : ""}` : state ? "no attitude yet" : "");
}

requestAnimationFrame(draw);

// ---- what is pressed ----

const ACTS = {
  pause: () => view.pause(), in: () => view.zoom(0.5), out: () => view.zoom(2), left: () => view.pan(-0.25),
  right: () => view.pan(0.25), live: () => view.live(),
};
const KEYS = { p: "pause", P: "pause", "+": "in", "-": "out", ArrowLeft: "left", ArrowRight: "right", 0: "live" };

function act(name) {
  ACTS[name]();
  showValues();
}

for (const button of document.querySelectorAll("[data-act]")) {
  button.addEventListener("click", () => act(button.dataset.act));
}
addEventListener("keydown", (event) => {
  const plain = !event.ctrlKey && !event.altKey && !event.metaKey && event.target.tagName !== "INPUT";
  if (plain && KEYS[event.key]) act(KEYS[event.key]);
});

const ORDERS = {
  parameters: readParameters,
  record: () => link.order({ do: "record", on: !state.recording.on }),
  step_test: () => link.order({
    do: "step_test", value: Number(byId("step-size").value), seconds: Number(byId("step-seconds").value),
  }),
};

function readParameters() {
  link.order({ do: "parameters" }, (said) => {
    if (!said.good) return;
    parameters.show(said.parameters);
    byId("filter").hidden = document.querySelector("[data-do=save]").hidden = false;
  });
}

byId("filter").addEventListener("input", () => parameters.filter(byId("filter").value));
byId("result-show").addEventListener("click", () => {
  const { begin_s: begin, seconds } = state.result;
  view.show(begin - MARGIN_S, begin + seconds + MARGIN_S);
});
for (const button of document.querySelectorAll("[data-do]")) {
  const what = button.dataset.do;
  button.addEventListener("click", () => (ORDERS[what] ?? (() => link.order({ do: what })))());
}
byId("setpoint-value").addEventListener("input", () => {
  setpointMoved();
  link.order({ do: "setpoint", value: Number(byId("setpoint-value").value) });
});
