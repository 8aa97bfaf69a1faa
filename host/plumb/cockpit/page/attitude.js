// Artificial horizon and the body in three dimensions, from a quaternion (body to world, z up) or from tilt and roll.

const DEG = Math.PI / 180;

export function quaternionOf(roll, pitch, yaw) {
  const [cr, sr, cp, sp, cy, sy] = [roll, pitch, yaw].flatMap((angle) => [Math.cos(angle / 2), Math.sin(angle / 2)]);
  return [cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
    cr * cp * sy - sr * sp * cy];
}

// Roll, pitch and yaw in deg, rotation order z, y, x.
export function anglesOf([w, x, y, z]) {
  return [Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
    Math.asin(Math.min(Math.max(2 * (w * y - z * x), -1), 1)),
    Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))].map((angle) => angle / DEG);
}

// The attitude in the newest row: {quaternion, yaw known}; null where the run has none.
export function attitudeOf(rows, columns, tiltAbout) {
  const last = (name) => {
    const at = columns.findIndex((column) => column.name === name);
    return at < 0 ? NaN : rows.last(at);
  };
  const quaternion = ["w", "x", "y", "z"].map(last);
  if (quaternion.every(Number.isFinite) && Math.hypot(...quaternion) > 0.5) {
    const size = Math.hypot(...quaternion);
    return { quaternion: quaternion.map((part) => part / size), yaw: true };
  }
  const tilt = last("tilt_deg") * DEG, roll = last("roll_deg") * DEG;
  if (!Number.isFinite(tilt)) return null;
  if (Number.isFinite(roll)) return { quaternion: quaternionOf(roll, tilt, 0), yaw: false };
  return { quaternion: tiltAbout === "y" ? quaternionOf(0, tilt, 0) : quaternionOf(tilt, 0, 0), yaw: false };
}

function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
  const size = Math.max(1, Math.round(box.width * ratio));
  if (canvas.width !== size) canvas.width = canvas.height = size;
  const pen = canvas.getContext("2d");
  pen.setTransform(size / 220, 0, 0, size / 220, 0, 0);
  pen.clearRect(0, 0, 220, 220);
  return pen;
}

export function drawHorizon(canvas, attitude, style) {
  const pen = prepared(canvas), perDeg = 2.4;
  pen.save();
  pen.beginPath();
  pen.arc(110, 110, 100, 0, 2 * Math.PI);
  pen.clip();
  if (attitude) {
    const [roll, pitch] = anglesOf(attitude.quaternion);
    pen.save();
    pen.translate(110, 110);
    pen.rotate(-roll * DEG);
    pen.translate(0, -pitch * perDeg);  // z up, y left: a positive pitch is nose down
    pen.fillStyle = style.sky;
    pen.fillRect(-500, -800, 1000, 800);
    pen.fillStyle = style.earth;
    pen.fillRect(-500, 0, 1000, 800);
    pen.strokeStyle = pen.fillStyle = "#fff";
    pen.lineWidth = 1.5;
    pen.font = "10px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.beginPath();
    pen.moveTo(-300, 0);
    pen.lineTo(300, 0);
    for (let at = -90; at <= 90; at += 10) {
      const half = at % 20 ? 14 : 28;
      if (!at) continue;
      pen.moveTo(-half, -at * perDeg);
      pen.lineTo(half, -at * perDeg);
      if (at % 20 === 0) pen.fillText(String(Math.abs(at)), half + 4, -at * perDeg);
    }
    pen.stroke();
    pen.restore();
  } else {
    pen.fillStyle = style.panel;
    pen.fillRect(0, 0, 220, 220);
  }
  pen.restore();
  pen.strokeStyle = style.rule;
  pen.lineWidth = 3;
  pen.beginPath();
  pen.arc(110, 110, 100, 0, 2 * Math.PI);
  pen.stroke();
  pen.strokeStyle = "#f2c037";
  pen.lineWidth = 4;
  pen.beginPath();
  pen.moveTo(50, 110);
  pen.lineTo(88, 110);
  pen.lineTo(96, 120);
  pen.moveTo(170, 110);
  pen.lineTo(132, 110);
  pen.lineTo(124, 120);
  pen.moveTo(108, 110);
  pen.lineTo(112, 110);
  pen.stroke();
}

function rotated([w, x, y, z], [a, b, c]) {
  const tx = 2 * (y * c - z * b), ty = 2 * (z * a - x * c), tz = 2 * (x * b - y * a);
  return [a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx];
}

// World to canvas: seen from behind, right and above; x forward, y left, z up.
function projected([x, y, z]) {
  const turn = -35 * DEG, lift = 24 * DEG;
  const across = -x * Math.sin(turn) - y * Math.cos(turn), deep = x * Math.cos(turn) - y * Math.sin(turn);
  return [110 + 62 * across, 116 - 62 * (z * Math.cos(lift) + deep * Math.sin(lift)), deep * Math.cos(lift) - z * Math.sin(lift)];
}

const HALF = [1.0, 0.62, 0.13];
const FACES = [[0, 1], [0, -1], [1, 1], [1, -1], [2, 1], [2, -1]];

function corners(axis, sign) {
  const [one, two] = [0, 1, 2].filter((other) => other !== axis);
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => {
    const at = [0, 0, 0];
    at[axis] = sign * HALF[axis];
    at[one] = a * HALF[one];
    at[two] = b * HALF[two];
    return at;
  });
}

export function drawBody(canvas, attitude, style) {
  const pen = prepared(canvas);
  if (!attitude) return;
  const place = (point) => projected(rotated(attitude.quaternion, point));
  const faces = FACES.map(([axis, sign]) => {
    const points = corners(axis, sign).map(place);
    return { axis, sign, points, deep: points.reduce((sum, point) => sum + point[2], 0) };
  }).sort((a, b) => b.deep - a.deep);
  pen.lineJoin = "round";
  for (const { axis, sign, points } of faces) {
    pen.beginPath();
    points.forEach(([x, y], index) => (index ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.closePath();
    pen.fillStyle = axis === 2 ? (sign > 0 ? "#2f6f4f" : "#1f4a35") : axis === 0 && sign > 0 ? "#c9a227" : "#3d8a63";
    pen.fill();
    pen.strokeStyle = style.ground;
    pen.lineWidth = 1.5;
    pen.stroke();
  }
  pen.font = "600 12px system-ui, sans-serif";
  pen.lineWidth = 2.5;
  [["x", [1.5, 0, 0], "#d33c31"], ["y", [0, 1.2, 0], "#2e9d60"], ["z", [0, 0, 0.95], "#3f7fd6"]]
    .forEach(([name, tip, colour]) => {
      const half = tip.map((part, axis) => (part ? HALF[axis] : 0)), [x0, y0] = place(half), [x1, y1] = place(tip);
      pen.strokeStyle = pen.fillStyle = colour;
      pen.beginPath();
      pen.moveTo(x0, y0);
      pen.lineTo(x1, y1);
      pen.stroke();
      pen.fillText(name, x1 + 3, y1 - 3);
    });
}
