// Health of the board and the link, and the log of the cockpit.

import { byId, element, setTable } from "./dom.js";

const count = (value) => value ?? "–";

export function showHealth({ health, image, unique_id: chip, own_run: own }) {
  const list = (texts) => (texts.length ? texts.join("; ") : "none");
  const lost = health.host_lost + health.host_lost_steps;
  setTable(document.querySelector("#health tbody"), [
    ["arming blocked", health.blocked.length ? list(health.blocked) : "by nothing", false],
    ["faults", list(health.faults), health.faults.length],
    ["last disarmed by", list(health.disarm_cause), false],
    ["mode", `${health.mode ?? "–"}${health.live ? ", own sensors" : ""}${own ? "" : ", another's run"}`, false],
    ...(health.battery_v == null ? [] : [
      ["battery", [`${health.battery_v.toFixed(2)} V, ${health.battery_a.toFixed(2)} A`, ...health.battery_trouble].join("; "),
        health.battery_trouble.length]]),
    ...Object.entries(health.choices).map(([name, text]) => [name.replaceAll("_", " "), text, false]),
    ...(health.flags_set === null ? [] : [
      ["flags", list(health.flags_set.map((name) => name.toLowerCase().replaceAll("_", " "))), false]]),
    ["step", `${count(health.step)}, ${health.steps_per_s?.toFixed(1) ?? "–"} per s`, false],
    ["saturated steps", count(health.saturated_steps), false],
    ["starved steps", count(health.starved_steps), false],
    ["lost here", `${health.host_lost_steps} steps, ${health.host_lost} other frames`, lost],
    ["rejected here", health.host_rejected, health.host_rejected],
    ["lost by the board", `${count(health.board_lost)} frames, ${count(health.board_rejected)} rejected, `
      + `${count(health.board_dropped)} dropped`, health.board_dropped],
    ["CAN", `${health.can_off_bus ? "off" : "on"} the bus; errors: ${count(health.can_transmit_errors)} sent, `
      + `${count(health.can_receive_errors)} received`, health.can_off_bus],
    ["chip", /^0*$/.test(chip) ? "none: a board in memory (--port native)" : chip, false],
    ["image", image || "of no known commit", false],
  ]);
}

let loggedLast = "";

export function showLog(notes) {
  const key = JSON.stringify(notes.at(-1) ?? null) + notes.length;
  if (key === loggedLast) return;
  loggedLast = key;
  document.querySelector("#log ol").replaceChildren(...notes.toReversed().map(([time, text]) => {
    const when = element("time", "", new Date(time * 1000).toLocaleTimeString());
    return element("li", "", when, text);
  }));
}

export function showAnswer(said) {
  byId("answer").textContent = said.text ?? "";
  byId("answer").className = said.good ? "" : "bad";
}
