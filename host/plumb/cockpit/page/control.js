// Who holds the board, what may be pressed and why not, the setpoint, and the result of a step test.

import { byId, setTable, setText } from "./dom.js";
import { fixed, shown } from "./scale.js";

function roleOf(said, mine) {
  if (!said.may_control) return "This page watches. It can stop the board.";
  if (mine) return "This page holds the board. Closed, hidden or silent, it disarms.";
  return said.held ? "Another page holds the board. This one can stop it." : "Nobody holds the board.";
}

// Why the board cannot be armed, "" when it can.
function whyNotArmed(said, mine) {
  if (!mine || said.armed || said.arming || said.lost) return "";
  if (said.watch) return "Arm is off: the cockpit was started with --watch.";
  if (said.setpoint === null) return said.why_no_setpoint ? `Arm is off: ${said.why_no_setpoint}.` : "";
  if (!said.own_run) return "Arm is off: the run is not this page's. Press New run first.";
  if (said.light.colour === "red") return "Arm is off: the board differs from the model.";
  return said.health.blocked.length ? `Arm waits until this is gone: ${said.health.blocked.join("; ")}.` : "";
}

export function showControl(said) {
  const mine = said.holds, here = said.armed || said.arming, differs = said.light.colour === "red";
  setText(byId("role"), roleOf(said, mine));
  setText(byId("why"), whyNotArmed(said, mine));
  const usable = {
    take: !said.held, release: mine, run: mine && !here && !said.watch && !said.lost,
    arm: mine && !here && said.own_run && said.setpoint !== null && !differs, record: mine && !said.lost,
    step_test: mine && said.armed_here && !said.test, parameters: mine && !said.lost,
    save: mine && !here && !said.lost,
  };
  for (const button of document.querySelectorAll("[data-do]")) button.disabled = !usable[button.dataset.do];
  byId("orders").hidden = !said.may_control;
  document.querySelector("[data-do=take]").hidden = mine;
  document.querySelector("[data-do=release]").hidden = !mine;
  const record = document.querySelector("[data-do=record]");
  setText(record, said.recording.on ? `Stop recording (${said.recording.steps})` : "Record");
  record.setAttribute("aria-pressed", String(said.recording.on));
  byId("setpoint").hidden = said.setpoint === null || !said.may_control;
  if (said.setpoint !== null) showSetpoint(said.setpoint, mine && said.armed_here, said.test);
  setText(document.querySelector("[data-do=step_test]"), said.test ? "testing" : "Step test");
  showResult(said.result);
}

const HAND_MS = 1000;
let movedAt = -Infinity;

// The slider was moved by hand: for a while it does not follow the board.
export function setpointMoved() { movedAt = performance.now(); }

// The value next to the slider is the board's own: the setpoint that its newest step used. The slider follows it.
function showSetpoint({ unit, most, used }, usable, test) {
  const slider = byId("setpoint-value"), size = byId("step-size");
  if (slider.max !== String(most)) {
    Object.assign(slider, { min: -most, max: most, value: 0 });
    size.value = most / 6;
    document.querySelector("#setpoint .unit").textContent = ` ${unit} `;
  }
  if (!usable || test || performance.now() - movedAt > HAND_MS) slider.value = used ?? 0;
  slider.disabled = !usable;
  setText(byId("setpoint-shown"), used === null ? "unknown" : `${fixed(used, 2)} ${unit}`);
}

function showResult(result) {
  byId("result").hidden = !result;
  if (!result) return;
  const { unit, size, rise_s: rise, settling_s: settling, overshoot_percent: overshoot, off } = result;
  setTable(document.querySelector("#result tbody"), [
    ["step", `${size} ${unit}`],
    ["rise time", rise === null ? "not reached" : `${fixed(rise, 3)} s`],
    ["overshoot", `${fixed(overshoot, 0)} %`],
    ["settling time", settling === null ? "not settled" : `${fixed(settling, 3)} s`],
    ["final error", `${shown(off)} ${unit}`],
  ]);
}
