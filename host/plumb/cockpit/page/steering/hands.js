// The hands: keyboard, gamepad and the two sticks on the page become sticks of a transmitter.

const SEND_MS = 20, KEY_SHARE = 0.55, KEY_PER_S = 5, DEAD = 0.08, MOST_CLIMB_MPS = 1.6, THROTTLE_PER_S = 0.4;
const HEIGHT_PER_S2 = 2, CLIMB_PER_S = 2.6, SUM_PER_S3 = 0.5, G = 9.80665, GROUND_M = 0.05, AHEAD_M = 1.2;
const LEAST_UPRIGHT = 0.1, LOW_THROTTLE = 0.06;
const KEYS = {
  KeyW: ["up", 1], KeyS: ["up", -1], KeyA: ["yaw", 1], KeyD: ["yaw", -1],
  ArrowUp: ["pitch", 1], ArrowDown: ["pitch", -1], ArrowRight: ["roll", 1], ArrowLeft: ["roll", -1],
};
const AXES = { yaw: [0, -1], up: [1, -1], roll: [2, 1], pitch: [3, -1] };
const BUTTONS = { 0: "motors", 1: "mode", 3: "height", 9: "run" };
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

export class Hands {
  // send: called with the sticks; did: with the name of what was pressed.
  constructor({ send, did }) {
    Object.assign(this, { did, down: new Set(), fast: false, pressed: new Set(), pad: null });
    this.keys = { roll: 0, pitch: 0, yaw: 0, up: 0 };
    this.touch = {};
    this.on = this.rate = this.armed = false;  // armed: the board; a throttle before that would keep it from it
    this.holds = true;
    this.hover = 0;  // null: no throttle, both sticks drive
    this.reset();
    this.at = performance.now();
    setInterval(() => send(this.read()), SEND_MS);
    addEventListener("blur", () => this.down.clear());
  }

  reset() { Object.assign(this, { throttle: 0, wanted: null, sum: 0, floor: null }); }

  switchMotors(on) {
    this.on = on;
    this.reset();
  }

  press(code, shift) { this.fast = shift; if (KEYS[code]) this.down.add(code); return Boolean(KEYS[code]); }
  release(code, shift) { this.fast = shift; this.down.delete(code); }

  // What the hands ask for: -1 to 1 each.
  asked(seconds) {
    const most = this.fast ? 1 : KEY_SHARE, sum = { roll: 0, pitch: 0, yaw: 0, up: 0 };
    for (const code of this.down) sum[KEYS[code][0]] += KEYS[code][1];
    for (const name of Object.keys(sum)) {
      const target = sum[name] * (name === "up" && this.hover !== null ? 1 : most), step = KEY_PER_S * seconds;
      this.keys[name] += clamp(target - this.keys[name], -step, step);
    }
    const pad = this.readGamepad();
    return Object.fromEntries(Object.keys(sum).map((name) => [name, clamp(this.keys[name] + (pad[name] ?? 0) + (this.touch[name] ?? 0), -1, 1)]));
  }

  readGamepad() {
    const found = [...(navigator.getGamepads?.() ?? [])].find((one) => one?.connected && one.axes.length >= 4);
    this.pad = found ? found.id : null;
    if (!found) return {};
    const down = new Set(found.buttons.flatMap((button, at) => (button.pressed ? [at] : [])));
    for (const at of down) if (!this.pressed.has(at) && BUTTONS[at]) this.did(BUTTONS[at]);
    this.pressed = down;
    const of = ([axis, sign]) => (Math.abs(found.axes[axis]) < DEAD ? 0 : sign * found.axes[axis]);
    return Object.fromEntries(Object.entries(AXES).map(([name, axis]) => [name, of(axis)]));
  }

  read() {
    const now = performance.now(), seconds = Math.min((now - this.at) / 1000, 0.1);
    this.at = now;
    const { roll, pitch, yaw, up } = this.asked(seconds);
    const drives = this.hover === null;
    const throttle = !drives && this.on && this.armed ? this.throttleFor(up, seconds) : 0;
    return { roll, pitch: drives ? clamp(pitch + up, -1, 1) : pitch, yaw, throttle, on: this.on, rate: this.rate };
  }

  throttleFor(up, seconds) {
    if (!this.holds || !this.hover || !this.seen) {
      this.throttle = clamp(this.throttle + up * THROTTLE_PER_S * seconds, 0, 1);
      this.wanted = null;
      return this.throttle;
    }
    return this.throttle = this.heldHeight(up, seconds);
  }

  // The page holds the height as a pilot does by eye; the stick asks for a climb.
  heldHeight(up, seconds) {
    const z = this.seen.position[2], climb = this.seen.velocity[2];
    this.floor ??= z;
    if (this.wanted === null) this.wanted = z;
    this.wanted = clamp(this.wanted + up * MOST_CLIMB_MPS * seconds, Math.max(z - AHEAD_M, this.floor - 1), z + AHEAD_M);
    if (z - this.floor < GROUND_M && up <= 0) { this.wanted = z; this.sum = 0; return 0; }
    const low = this.wanted - z;
    this.sum = clamp(this.sum + low * seconds, -2, 2);
    const accel = HEIGHT_PER_S2 * low + CLIMB_PER_S * (up * MOST_CLIMB_MPS - climb) + SUM_PER_S3 * this.sum;
    const [, x, y] = this.seen.attitude, upright = 1 - 2 * (x * x + y * y);
    if (upright < LEAST_UPRIGHT) return LOW_THROTTLE;  // thrust to the side or down lifts nothing
    return clamp(this.hover * (1 + 0.75 * clamp(accel, -5, 8) / G) / Math.max(upright, 0.6), LOW_THROTTLE, 0.9);
  }
}

// A stick on the page that a pointer moves; x and y: what its axes are to Hands.
export function stick(element, hands, x, y) {
  const move = (event) => {
    const box = element.getBoundingClientRect(), at = (value, low, size) => clamp(2.3 * ((value - low) / size - 0.5), -1, 1);
    hands.touch[x.name] = x.sign * at(event.clientX, box.left, box.width);
    hands.touch[y.name] = y.sign * at(event.clientY, box.top, box.height);
  };
  const release = () => { delete hands.touch[x.name]; delete hands.touch[y.name]; };
  element.addEventListener("pointerdown", (event) => { element.setPointerCapture(event.pointerId); move(event); });
  element.addEventListener("pointermove", (event) => { if (element.hasPointerCapture(event.pointerId)) move(event); });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) element.addEventListener(end, release);
}
