// The page of a trip, a flight or a ride: what is shown, what is pressed, and the sticks that go to the receiver.

import { byId, element, setText } from "./dom.js";
import { Gauges } from "./gauges.js";
import { Hands, stick } from "./hands.js";
import { gone, showLight, trouble } from "./light.js";
import { Link } from "./link.js";
import { Scene, VIEWS } from "./scene.js";
import { capital, hint, name as nameAll } from "./words.js";

const COLOURS = ["haze", "zenith", "ground", "line", "mark", "wind", "ghost", "vqf", "mahony", "shade"], NOTES = 12;
let state = null, drawing = null, scene = null, drawnAt = 0, notesShown = "", trip = null, begun = null;

try {
  scene = new Scene(byId("scene"));
} catch {
  byId("flat").hidden = false;
}

const hands = new Hands({ send: sendSticks, did: act });
const gauges = new Gauges(happen);
const KINDS = { drawing: showDrawing, scene: showScene };

class TripLink extends Link {
  take(data) {
    const said = JSON.parse(data), shown = KINDS[said.type];
    if (!shown) { super.take(data); return; }
    this.receivedAt = performance.now();
    this.tick = said.tick ?? this.tick;
    shown(said);
  }
}

const link = new TripLink(null, { received: showState, answered: showAnswer, silent, alive: () => false });

// Sticks are the page's sign of life: a hidden page sends none, and is a lost receiver.
const steers = () => Boolean(state?.holds) && !document.hidden;

function happen(name) { if (name) link.order({ do: "happen", name }); }

function sendSticks(sticks) {
  if (steers()) link.send({ do: "sticks", tick: link.drawnTick, ...sticks });
}

// ---- what is shown ----

function silent() {
  state = null;
  gone(`plumb ${drawing?.command ?? ""} does not answer: it has ended, or hangs.`);
}

function showDrawing(said) {
  if (drawing) return;
  drawing = said;
  hands.hover = said.controls.hover;
  gauges.build(said);
  nameAll(said);
  setText(byId("chip"), said.chip_share ? `The step takes at most ${(100 * said.chip_share).toFixed(1)} % of an STM32F103.` : "");
  if (!scene) return;
  paint();
  scene.build(said);
  scene.resize();
}

function showScene(said) {
  if (!said.position) return;
  hands.seen = said;
  begun ??= said.position;
  scene?.push(said);
  gauges.show(said, hands);
}

function chip(id, said, kind) {
  setText(byId(id), said);
  byId(id).className = `chip ${kind}`;
}

function showState(said) {
  state = said;
  hands.armed = said.armed === true;
  document.querySelector("aside").inert = false;
  if (!said.light || !drawing) { trouble("waiting for the vehicle"); return; }
  trouble("");
  if (said.may_control && !said.held && !document.hidden) link.order({ do: "take" });
  chip("rate", `${Math.round(100 * said.speed)} % of real time`, said.speed < 0.9 ? "open" : "");
  byId("rate").title = said.speed < 0.9 ? "This machine is too slow or too busy: end other programs." : "how fast time passes";
  if (trip !== said.run) { trip = said.run; begun = null; hands.switchMotors(false); scene?.begin(); }
  if (said.over && hands.on) hands.switchMotors(false);
  setText(byId("system"), said.system);
  showLight(said.light);
  chip("receiver", said.receiving ? "receiver ok" : "receiver lost", said.receiving ? "good" : "bad");
  chip("armed", said.armed ? "ARMED" : "disarmed", said.armed ? "armed" : "");
  const { motors, modes, trip: noun } = drawing.controls;
  const [text, kind] = hint(said, drawing, hands.seen, begun, hands.holds), may = said.holds && !said.over;
  setText(byId("hint"), text);
  byId("hint").className = kind;
  setText(byId("said"), said.over ? `the ${noun} is over` : said.armed ? said.said : `${motors} off`);
  press("motors-on", hands.on, `${capital(motors)} ${hands.on ? "off" : "on"}`, may);
  if (modes.length) press("mode", hands.rate, capital(modes[Number(hands.rate)]), may);
  press("hold", hands.holds, "Hold height", may);
  byId("new").disabled = !said.holds;
  gauges.showEvents(said.happening, may);
  setText(byId("camera"), `camera ${VIEWS[scene?.view ?? 0]}`);
  setText(byId("gamepad"), hands.pad ? `gamepad: ${hands.pad}` : `Gamepad: press a button of it. A: ${motors}, B: as M${modes.length ? ", Y: as H" : ""}.`);
  showLog(said);
}

function press(id, pressed, text, may) {
  const button = byId(id);
  button.setAttribute("aria-pressed", String(pressed));
  button.disabled = !may;
  setText(button, text);
}

function showLog({ notes, reports }) {
  const key = JSON.stringify([notes.length, notes.at(-1), reports]);
  if (key === notesShown) return;
  notesShown = key;
  document.querySelector("#log ol").replaceChildren(...notes.slice(-NOTES).reverse().map(([at, text]) =>
    element("li", "", element("time", "", new Date(1000 * at).toTimeString().slice(0, 8)), text)));
  byId("reports").replaceChildren(...reports.map((name, at) => {
    const link = element("a", "", `report of ${drawing.controls.trip} ${at + 1}`);
    link.href = `reports/${name}`;
    link.target = "_blank";
    return link;
  }));
}

function showAnswer(said) {
  if (!said.good && said.text) { setText(byId("said"), said.text); byId("said").className = "bad"; } else byId("said").className = "";
}

// ---- what is drawn ----

function paint() {
  const of = getComputedStyle(document.documentElement);
  scene?.paint(Object.fromEntries(COLOURS.map((name) => [name, of.getPropertyValue(`--scene-${name}`).trim()])));
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", paint);
new ResizeObserver(() => scene?.resize()).observe(byId("stage"));

function draw(now) {
  requestAnimationFrame(draw);
  const seconds = Math.min((now - drawnAt) / 1000, 0.2);
  drawnAt = now;
  scene?.draw(seconds);
  link.drawn();
}
requestAnimationFrame(draw);

// ---- what is pressed ----

const ACTS = {
  motors: () => hands.switchMotors(!hands.on && state?.settled === true && !state.over),
  off: () => hands.switchMotors(false),
  mode: () => { if (drawing.controls.modes.length) hands.rate = !hands.rate; else happen(drawing.controls.event); },
  height: () => { if (drawing.controls.hover) hands.holds = !hands.holds; },
  camera: () => { if (scene) scene.view = (scene.view + 1) % VIEWS.length; },
  run: () => link.order({ do: "run" }),
};
const KEYS = { Enter: "motors", Escape: "off", KeyM: "mode", KeyH: "height", KeyC: "camera", KeyR: "run" };

function act(name) {
  if ((!state?.holds || !drawing) && name !== "camera") return;
  ACTS[name]();
  if (state) showState(state);
}

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (hands.press(event.code, event.shiftKey)) { event.preventDefault(); return; }
  const digit = /^Digit([1-9])$/.exec(event.code);
  if (digit && !event.repeat && state?.holds && !state.over) happen(drawing?.events[digit[1] - 1]?.name);
  if (!KEYS[event.code]) return;
  event.preventDefault();
  if (!event.repeat) act(KEYS[event.code]);
}, { capture: true });
addEventListener("keyup", (event) => hands.release(event.code, event.shiftKey), { capture: true });
for (const [id, name] of [["motors-on", "motors"], ["mode", "mode"], ["hold", "height"], ["camera", "camera"], ["new", "run"]]) {
  byId(id).addEventListener("click", () => act(name));
}
for (const button of document.querySelectorAll("[data-ghost]")) {
  button.addEventListener("click", () => {
    const shown = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(shown));
    if (shown) scene?.wanted.add(button.dataset.ghost); else scene?.wanted.delete(button.dataset.ghost);
  });
}
stick(byId("left"), hands, { name: "yaw", sign: -1 }, { name: "up", sign: -1 });
stick(byId("right"), hands, { name: "roll", sign: 1 }, { name: "pitch", sign: -1 });
