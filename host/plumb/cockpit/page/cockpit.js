// The page of the cockpit: the link to the server, the heartbeat, and what is shown and pressed.

import { Rows, View, fixed, panelsOf } from "./plots.js";
import { showParameters, filterParameters } from "./parameters.js";
import { anglesOf, attitudeOf, drawBody, drawHorizon } from "./attitude.js";

const HEARTBEAT_MS = 100, FRAME_MS = 1000 / 31, RECONNECT_MS = 1000, SILENT_MS = 1500;
const $ = (id) => document.getElementById(id);
const rows = new Rows(), view = new View(rows);
let heardAt = 0, socket = null, state = null, panels = [], shownRun = "", tick = 0, number = 0, style = {};
const waiting = new Map();

// ---- the link ----

function connect() {
  socket = new WebSocket(`ws://${location.host}${location.pathname}live`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => {
    heardAt = performance.now();
    if (typeof data !== "string") { tick = rows.push(data); return; }
    const said = JSON.parse(data);
    if (said.type === "state") showState(said);
    else answered(said);
  };
  socket.onclose = () => {
    silent();
    setTimeout(connect, RECONNECT_MS);
  };
}

// Nothing on the page is of the present any more: the light is out, and says so.
function silent() {
  state = null;
  trouble("plumb cockpit does not answer: it has ended, or hangs. The board is disarmed without it.");
  $("light").className = "off";
  $("light-text").textContent = "no connection";
}

setInterval(() => {
  if (state && performance.now() - heardAt > SILENT_MS) silent();
}, SILENT_MS / 2);

function send(order) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(order));
}

function order(what, then) {
  number += 1;
  if (then) waiting.set(number, then);
  send({ ...what, number });
}

function answered(said) {
  const then = waiting.get(said.number);
  waiting.delete(said.number);
  $("answer").textContent = said.text ?? "";
  $("answer").className = said.good ? "" : "bad";
  if (then) then(said);
}

// The page that holds the board is its dead man's handle: a hidden page is a hand off it.
setInterval(() => {
  if (state?.holds && !document.hidden) send({ do: "alive", tick });
}, HEARTBEAT_MS);

function stop() { send({ do: "stop" }); }

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
$("stop").addEventListener("click", stop);

// ---- what is shown ----

function trouble(text) {
  $("trouble").textContent = text;
  $("trouble").hidden = !text;
}

function showState(said) {
  state = said;
  tick = said.tick;
  if (!said.light) { trouble("waiting for the board"); return; }
  trouble(said.lost ? `${said.lost}. The cockpit tries to open the board again.` : said.mismatch);
  $("slow").textContent = said.speed < 0.9 ? `The simulated board runs at ${said.speed.toFixed(1)} of real time.` : "";
  $("system").textContent = `${said.run?.system ?? ""} on ${said.board}`;
  $("light").className = said.light.colour;
  $("light-text").textContent = said.light.text;
  const armed = $("armed");
  armed.className = said.armed ? "armed" : "disarmed";
  armed.textContent = said.armed ? (said.armed_here ? "ARMED" : "ARMED elsewhere") : said.arming ? "arming" : "disarmed";
  const key = JSON.stringify(said.run?.columns.map((column) => column.name) ?? []);
  if (key !== shownRun) {
    shownRun = key;
    panels = panelsOf(said.run?.columns ?? [], rows, view);
    $("panels").replaceChildren(...panels.map((panel) => panel.element));
  }
  showControl(said);
  showHealth(said);
  showLog(said.notes);
  $("missed").textContent = rows.missed ? `${rows.missed} rows were not drawn: this page is slow. A recording has them.` : "";
}

function showControl(said) {
  const mine = said.holds, here = said.armed || said.arming;
  $("role").textContent = !said.may_control ? "This page watches. It can stop the board."
    : mine ? "This page holds the board. Closed, hidden or silent, it disarms." : said.held
      ? "Another page holds the board. This one can stop it." : "Nobody holds the board.";
  const usable = {
    take: said.may_control && !mine, release: mine, run: mine && !here && !said.watch,
    arm: mine && !here && said.own_run && said.setpoint !== null, record: mine,
    step_test: mine && said.armed_here && !said.test, parameters: mine && !here, save: mine && !here,
  };
  for (const button of document.querySelectorAll("[data-do]")) button.disabled = !usable[button.dataset.do];
  const record = document.querySelector("[data-do=record]");
  record.textContent = said.recording.on ? `Stop recording (${said.recording.steps})` : "Record";
  record.setAttribute("aria-pressed", String(said.recording.on));
  $("setpoint").hidden = said.setpoint === null || !said.may_control;
  if (said.setpoint !== null) showSetpoint(said.setpoint, mine && said.armed_here);
}

function showSetpoint({ unit, most }, usable) {
  const slider = $("setpoint-value"), size = $("step-size");
  if (slider.max !== String(most)) {
    Object.assign(slider, { min: -most, max: most, value: 0 });
    size.value = most / 6;
    document.querySelector("#setpoint .unit").textContent = ` ${unit} `;
  }
  if (!usable) slider.value = 0;
  slider.disabled = !usable;
  $("setpoint-shown").textContent = `${Number(slider.value).toFixed(2)} ${unit}`;
}

function showHealth({ health, image, unique_id: chip, own_run: own }) {
  const list = (texts) => (texts.length ? texts.join("; ") : "none");
  const count = (value) => value ?? "–";
  const lost = health.host_lost + health.host_lost_steps;
  const lines = [
    ["arming blocked by", health.blocked.length ? list(health.blocked) : "nothing", false],
    ["faults", list(health.faults), health.faults.length],
    ["last disarmed by", list(health.disarm_cause), false],
    ["mode", `${health.mode ?? "–"}${health.live ? ", live" : ""}${own ? "" : ", another's run"}`, false],
    ["step", `${count(health.step)}, ${health.steps_per_s?.toFixed(1) ?? "–"}/s`, false],
    ["saturated, starved", `${count(health.saturated_steps)}, ${count(health.starved_steps)}`, false],
    ["lost here", `${health.host_lost_steps} steps, ${health.host_lost} other frames`, lost],
    ["rejected here", health.host_rejected, health.host_rejected],
    ["lost by the board", `${count(health.board_lost)} frames, ${count(health.board_rejected)} rejected, `
      + `${count(health.board_dropped)} dropped`, health.board_dropped],
    ["CAN", `${health.can_off_bus ? "off" : "on"} the bus, errors ${count(health.can_transmit_errors)} sent, `
      + `${count(health.can_receive_errors)} received`, health.can_off_bus],
    ["chip", `${chip}, image ${image || "of no known commit"}`, false],
  ];
  const body = document.querySelector("#health tbody");
  while (body.rows.length < lines.length) body.append(row());
  lines.forEach(([name, text, bad], index) => {
    const line = body.rows[index];
    line.className = bad ? "bad" : "";
    if (line.cells[0].textContent !== name) line.cells[0].textContent = name;
    if (line.cells[1].textContent !== String(text)) line.cells[1].textContent = text;
  });
}

function row() {
  const line = document.createElement("tr");
  line.append(document.createElement("td"), document.createElement("td"));
  return line;
}

let loggedLast = "";

function showLog(notes) {
  const key = JSON.stringify(notes.at(-1) ?? null) + notes.length;
  if (key === loggedLast) return;
  loggedLast = key;
  document.querySelector("#log ol").replaceChildren(...notes.toReversed().map(([time, text]) => {
    const item = document.createElement("li"), when = document.createElement("time");
    when.textContent = new Date(time * 1000).toLocaleTimeString();
    item.append(when, text);
    return item;
  }));
}

function readStyle() {
  const of = getComputedStyle(document.documentElement);
  for (const name of ["ground", "text", "soft", "rule", "panel", "sky", "earth", "line"]) {
    style[name] = of.getPropertyValue(`--${name}`).trim();
  }
}
readStyle();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", readStyle);

let drawnAt = 0;

function draw(now) {
  requestAnimationFrame(draw);
  if (now - drawnAt < FRAME_MS - 4) return;
  drawnAt = now;
  for (const panel of panels) panel.draw(style);
  $("newest").value = rows.newest;
  $("cursor-time").textContent = view.cursor === null ? "" : `${view.cursor.toFixed(3)} s`;
  document.querySelector("[data-act=pause]").setAttribute("aria-pressed", String(view.end !== null));
  const attitude = state?.run ? attitudeOf(rows, state.run.columns, state.tilt_about) : null;
  drawHorizon($("horizon"), attitude, style);
  drawBody($("body"), attitude, style);
  if (attitude) {
    const [roll, pitch, yaw] = anglesOf(attitude.quaternion).map((angle) => `${fixed(angle, 1)}°`);
    $("angles").textContent = `roll ${roll}  pitch ${pitch}${attitude.yaw ? `  yaw ${yaw}` : ""}`;
  } else $("angles").textContent = "";
}
requestAnimationFrame(draw);

// ---- what is pressed ----

const ACTS = {
  pause: () => view.pause(), in: () => view.zoom(0.5), out: () => view.zoom(2), left: () => view.pan(-0.25),
  right: () => view.pan(0.25), live: () => view.live(),
};
const KEYS = { p: "pause", P: "pause", "+": "in", "-": "out", ArrowLeft: "left", ArrowRight: "right", 0: "live" };
for (const button of document.querySelectorAll("[data-act]")) {
  button.addEventListener("click", () => ACTS[button.dataset.act]());
}
addEventListener("keydown", (event) => {
  const plain = !event.ctrlKey && !event.altKey && !event.metaKey && event.target.tagName !== "INPUT";
  if (plain && KEYS[event.key]) ACTS[KEYS[event.key]]();
});

const ORDERS = {
  parameters: readParameters,
  save: () => order({ do: "save" }),
  record: () => order({ do: "record", on: !state.recording.on }),
  step_test: () => order({ do: "step_test", value: Number($("step-size").value), seconds: Number($("step-seconds").value) }),
};
function readParameters() {
  order({ do: "parameters" }, (said) => {
    if (!said.good) return;
    showParameters($("rows"), said.parameters, order);
    $("filter").hidden = document.querySelector("[data-do=save]").hidden = false;
  });
}
$("filter").addEventListener("input", () => filterParameters($("rows"), $("filter").value));

for (const button of document.querySelectorAll("[data-do]")) {
  const what = button.dataset.do;
  button.addEventListener("click", () => (ORDERS[what] ?? (() => order({ do: what })))());
}
$("setpoint-value").addEventListener("input", () => order({ do: "setpoint", value: Number($("setpoint-value").value) }));

connect();
