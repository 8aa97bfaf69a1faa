// Texts of the page about a vehicle: its names, the effects of its keys, and the next action.

import { byId, element, setText } from "./dom.js";

export const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
export const flies = (controls) => controls.hover !== null;
const MOVED_M = 0.15, KEYS_A_ROW = 2;
// A phone or tablet: its hints name what a finger reaches, and the table of keys is not shown (steering.css).
const touch = matchMedia("(hover: none) and (pointer: coarse)");

function keysOf({ motors, modes, event, ...controls }, events) {
  const named = events.find(({ name }) => name === event), mode = modes.length ? modes.join(", ") : named?.label.toLowerCase();
  const drive = flies(controls)
    ? [["W S", "climb, sink"], ["A D", "turn"], ["↑ ↓", "forward, back"], ["← →", "left, right"]]
    : [["W S", "forward, back"], ["A D", "turn"], ["↑ ↓", "forward, back"], ["← →", "turn"]];
  return [["Enter", `${motors} on, off`], ["Esc", `${motors} off`], ...drive, ["Shift", "full sticks"],
    ...(mode ? [["M", mode]] : []), ...(flies(controls) ? [["H", "hold height"]] : []), ["C", "camera"], [`1 – ${events.length}`, "the buttons"]];
}

// Everything on the page that has the name of the vehicle's parts.
export function name({ command, controls, events, estimate }) {
  document.title = `plumb ${command}`;
  setText(byId("command"), command);
  setText(byId("new"), `New ${controls.trip}`);
  byId("new").title = `write the record of this ${controls.trip}, and begin another (R)`;
  setText(byId("estimate-text"), estimate);
  const [left, right] = flies(controls) ? ["climb, yaw", "pitch, roll"] : ["drive, turn", "drive, turn"];
  setText(document.querySelector("#left span"), left);
  setText(document.querySelector("#right span"), right);
  byId("hold").hidden = !controls.hover;
  byId("mode").hidden = !controls.modes.length;
  const cells = keysOf(controls, events).map(([keys, does]) =>
    [element("td", "", ...keys.split(" ").flatMap((key, at) => (key === "–" ? [" –"] : [at ? " " : "", element("kbd", "", key)]))), element("td", "", does)]);
  const rows = cells.flatMap((_, at) => (at % KEYS_A_ROW ? [] : [element("tr", "", ...cells.slice(at, at + KEYS_A_ROW).flat())]));
  document.querySelector("#keys tbody").replaceChildren(...rows);
}

// The next action, and whether it is bad news. begun: where the vehicle was at first; holds: whether the page holds the height.
export function hint(said, { controls }, seen, begun, holds) {
  const { trip, motors, first } = controls, fingers = touch.matches;
  if (said.over) return [`The ${trip} is over and recorded${said.holds ? `. New ${trip}${fingers ? " begins another" : ": R"}` : ""}`, ""];
  if (said.happening.includes("lost")) return ["The receiver gets no signal", "bad"];
  if (said.on && said.why) return [said.why, "bad"];
  if (!said.holds) return ["Another page steers; this one watches", ""];
  if (!said.settled) return ["The sensors settle", ""];
  if (!said.on) return [said.armed ? `${capital(motors)} off` : fingers ? `Tap ${capital(motors)} on` : `Enter switches the ${motors} on`, ""];
  if (!said.armed) return ["Arming", ""];
  const moved = seen && begun ? Math.hypot(...seen.position.map((value, at) => value - begun[at])) : 0;
  if (moved >= MOVED_M) return ["", ""];
  if (fingers) return ["Move the left stick up", ""];
  return [flies(controls) && !holds ? "W gives throttle" : first, ""];
}
