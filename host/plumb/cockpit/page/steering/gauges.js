// Numbers, motors, sticks and what may happen, as elements of the page.

import { byId, element, setText } from "./dom.js";

const DEG = Math.PI / 180, TRAVEL = 38;

export class Gauges {
  // happen: called with the name of what is to happen.
  constructor(happen) { this.happen = happen; }

  build({ motors, events, readings, controls }) {
    this.hover = controls.hover;
    this.readings = readings.map(({ label, unit }) => {
      const value = element("output", "", "0.0");
      value.id = label;
      byId("readings").append(element("div", "", element("dt", "", label), element("dd", "", value, element("small", "", unit))));
      return value;
    });
    this.motors = motors.map((name) => {
      const bar = element("i"), value = element("output");
      byId("motors").append(element("div", "motor", element("span", "", name), element("div", controls.hover === null ? "bar both" : "bar", bar), value));
      return { bar, value };
    });
    this.events = events.map(({ name, label, text }) => {
      const button = element("button", "", label);
      button.type = "button";
      button.title = text;
      button.dataset.event = name;
      button.addEventListener("click", () => this.happen(name));
      byId("events").append(button);
      return { name, text, button };
    });
  }

  showEvents(happening, may) {
    if (!this.events) return;
    for (const { name, button } of this.events) {
      button.className = happening.includes(name) ? "on" : "";
      button.disabled = !may;
    }
    setText(byId("event-text"), this.events.filter(({ name }) => happening.includes(name)).map(({ text }) => text).join("; "));
  }

  show({ readings, motors, wind, attitude, estimate, rivals, sticks }, hands) {
    const number = (value) => value.toFixed(1).replace("-0.0", "0.0").replace("-", "−");
    this.readings?.forEach((value, at) => setText(value, number(readings[at])));
    const up = vertical(attitude), each = { ...rivals, ...(estimate ? { estimate: vertical(estimate) } : {}) };
    for (const button of document.querySelectorAll("[data-ghost]")) {
      const of = each[button.dataset.ghost];
      button.parentElement.hidden = !of;
      if (of) setText(button.nextElementSibling, `${apart(up, of).toFixed(1)}°`);
    }
    byId("wind").parentElement.hidden = !wind;
    if (wind) setText(byId("wind"), `${number(Math.hypot(...wind))} m/s`);
    this.motors?.forEach(({ bar, value }, at) => {
      bar.style.transform = `scaleX(${motors[at]})`;
      setText(value, `${Math.round(100 * motors[at])} %`.replace("-", "−"));
    });
    const [roll, pitch, yaw, throttle] = sticks;
    if (this.hover === null) { dot("left", -yaw, 0); dot("right", roll, pitch); return; }
    const lift = hands.holds && hands.hover ? Math.min(Math.max(hands.touch.up ?? hands.keys.up, -1), 1) : 2 * throttle - 1;
    dot("left", -yaw, lift);
    dot("right", roll, pitch);
  }
}

function dot(id, x, y) {
  byId(id).querySelector("i").style.transform = `translate(${TRAVEL * x}px, ${-TRAVEL * y}px)`;
}

// The vertical in body axes.
const vertical = ([w, x, y, z]) => [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)];

// Angle between two verticals in deg.
function apart([ax, ay, az], [bx, by, bz]) {
  const cross = Math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx);
  return Math.atan2(cross, ax * bx + ay * by + az * bz) / DEG;
}
