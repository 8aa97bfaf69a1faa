// The place in three dimensions: ground, sky, trees, the vehicle by the truth, the estimate as a ghost, wind and trail.

import { Camera, Cylinder, Geometry, Mesh, Plane, Renderer, Sphere, Transform } from "./ogl.min.js";
import { ground, sky, solid } from "./shader.js";
import { ghostVehicle, rgb, shadowVehicle, solidVehicle } from "./vehicle.js";

const TRAIL = 300, TRAIL_EVERY_S = 0.05, NOT_YET = 3, SMOOTH_S = 0.045, CAMERA_S = 0.25, TREES = 46, GHOST_SIZE = 1.1;
const STAND = [-3.2, -2.2, 1.7], FIELD_M = 1.5, UP = 0.43, WIDE_DEG = 50, NARROW_DEG = 9, DEG = Math.PI / 180;
const SLOW_MS = 26, FRAMES_TO_JUDGE = 40, LEAST_DPR = 0.5;
const GHOSTS = { estimate: "ghost", VQF: "vqf", Mahony: "mahony" };
export const VIEWS = ["behind it", "from the ground", "on board"];

const mix = (from, to, share) => from.map((value, at) => value + (to[at] - value) * share);
const unit = (values) => { const size = Math.hypot(...values) || 1; return values.map((value) => value / size); };
export const headingOf = ([w, x, y, z]) => Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
const times = ([a, b, c, d], [w, x, y, z]) => [a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y,
  a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w];

// A quaternion between two, on the shorter way.
function between(from, to, share) {
  const near = from.reduce((sum, value, at) => sum + value * to[at], 0) < 0 ? to.map((value) => -value) : to;
  return unit(mix(from, near, share));
}

// An attitude by its vertical in body axes: the true one, turned on the shortest way.
function leaned(attitude, up) {
  const [w, x, y, z] = attitude, [a, b, c] = up;
  const tx = 2 * (y * c - z * b), ty = 2 * (z * a - x * c), tz = 2 * (x * b - y * a);
  const [ex, ey, ez] = [a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx];
  return times(unit([1 + ez, ey, -ex, 0]), attitude);
}

function* drawn(seed) {  // the same trees on every page
  for (let state = seed; ;) { state = (state * 1103515245 + 12345) % 2147483648; yield state / 2147483648; }
}

// Throws an Error where the browser has no WebGL 2.
export class Scene {
  constructor(canvas) {
    if (!canvas.getContext("webgl2", { antialias: true, alpha: false })) throw new Error("no WebGL 2");
    this.canvas = canvas;
    this.dpr = Math.min(window.devicePixelRatio || 1, 2);
    this.renderer = new Renderer({ canvas, dpr: this.dpr, antialias: true });
    this.gl = this.renderer.gl;
    this.camera = new Camera(this.gl, { fov: WIDE_DEG, near: 0.05, far: 2500 });
    this.camera.up.set(0, 0, 1);
    this.root = new Transform();
    this.view = 0;
    this.shared = Object.fromEntries(["haze", "zenith", "ground", "line", "mark", "wind", "ghost", "vqf", "mahony", "shade"].map((name) => [name, { value: [0, 0, 0] }]));
    this.newest = this.shown = this.headingOff = null;
    this.went = false;  // the motors were on
    this.slow = this.frames = 0;
    this.trail = [];
    this.trailAt = -1;
    this.wanted = new Set(["estimate"]);
  }

  // colours: #rrggbb by name.
  paint(colours) {
    for (const [name, uniform] of Object.entries(this.shared)) uniform.value.splice(0, 3, ...rgb(colours[name]));
  }

  build(drawing) {
    const { gl, shared } = this, { haze } = shared, root = new Transform(), shade = (uniform, more) => solid(gl, haze, uniform.value, more);
    const dome = new Mesh(gl, { geometry: new Sphere(gl, { radius: 1500 }), program: sky(gl, haze, shared.zenith), frustumCulled: false });
    const field = new Mesh(gl, { geometry: new Plane(gl, { width: 3000, height: 3000 }), program: ground(gl, haze, shared.ground, shared.line, shared.mark), frustumCulled: false });
    dome.renderOrder = -2;
    field.renderOrder = -1;
    this.away = drawing.away_m;
    this.dome = dome;
    this.field = field;
    this.vehicle = solidVehicle(gl, haze, drawing.shapes.filter(({ during }) => !during));
    this.below = solidVehicle(gl, haze, drawing.shapes.filter(({ during }) => during));  // does not lean
    this.ghosts = Object.fromEntries(Object.entries(GHOSTS).map(([name, colour], at) => {
      const ghost = ghostVehicle(gl, haze, drawing.shapes, shared[colour].value), size = GHOST_SIZE + 0.04 * at;
      ghost.scale.set(size, size, size);
      ghost.setParent(root);
      return [name, ghost];
    }));
    this.shadow = shadowVehicle(gl, haze, drawing.shapes, shared.shade.value);
    this.stalk = new Mesh(gl, { geometry: new Cylinder(gl, { radiusTop: 0.003, radiusBottom: 0.003, height: 1 }), program: shade(shared.line, { alpha: 0.6, lit: 0 }) });
    this.arrow = this.windArrow(shade(shared.wind));
    for (const part of [dome, field, this.below, this.vehicle, this.shadow.flat, this.stalk, this.arrow]) part.setParent(root);
    this.plantTrees(root);
    this.line = this.trailLine(shade(shared.mark, { alpha: 0.7, lit: 0 }));
    this.line.setParent(root);
    this.root = root;
  }

  windArrow(program) {
    const arrow = new Transform(), { gl } = this;
    const shaft = new Mesh(gl, { geometry: new Cylinder(gl, { radiusTop: 0.012, radiusBottom: 0.012, height: 1 }), program });
    const head = new Mesh(gl, { geometry: new Cylinder(gl, { radiusTop: 0, radiusBottom: 0.04, height: 0.1, radialSegments: 16 }), program });
    shaft.setParent(arrow);
    head.setParent(arrow);
    Object.assign(this, { shaft, head });
    return arrow;
  }

  plantTrees(root) {
    const { gl, shared: { haze } } = this, number = drawn(7), next = () => number.next().value;
    const crowns = ["#4d7c5b", "#5d8a5f", "#3f6d57"].map((colour) => solid(gl, haze, rgb(colour))), trunk = solid(gl, haze, rgb("#7a6350"));
    const cone = new Cylinder(gl, { radiusTop: 0, radiusBottom: 1, height: 2.6, radialSegments: 7 }), stem = new Cylinder(gl, { radiusTop: 0.12, radiusBottom: 0.16, height: 1 });
    for (let tree = 0; tree < TREES; tree++) {
      const away = 20 + 90 * next() ** 1.5, angle = 2 * Math.PI * next(), size = 0.7 + 0.9 * next(), place = new Transform();
      place.position.set(away * Math.cos(angle), away * Math.sin(angle), 0);
      place.scale.set(size, size, size);
      [[stem, trunk, 0.5], [cone, crowns[tree % 3], 2.0], [cone, crowns[(tree + 1) % 3], 3.0]].forEach(([geometry, program, z], at) => {
        const mesh = new Mesh(gl, { geometry, program });
        mesh.rotation.x = Math.PI / 2;
        mesh.position.z = z;
        if (at === 2) mesh.scale.set(0.7, 0.7, 0.7);
        mesh.setParent(place);
      });
      place.setParent(root);
    }
  }

  trailLine(program) {
    this.points = new Float32Array(3 * TRAIL);
    const geometry = new Geometry(this.gl, {
      position: { size: 3, data: this.points, usage: this.gl.DYNAMIC_DRAW }, normal: { size: 3, data: new Float32Array(3 * TRAIL) },
    });
    return new Mesh(this.gl, { geometry, program, mode: this.gl.LINE_STRIP, frustumCulled: false });
  }

  // Another trip begins.
  begin() { this.shown = this.headingOff = null; this.went = false; this.trail = []; this.trailAt = -1; }

  // What the server saw. The heading of the estimate is the gyro's alone: it is the true one until the motors are on.
  push(seen) {
    this.went ||= seen.armed;
    if (!this.went) this.headingOff = null;
    if (this.newest && seen.time_s < this.newest.time_s) this.begin();
    this.newest = seen;
    if (seen.estimate && this.headingOff === null) this.headingOff = headingOf(seen.attitude) - headingOf(seen.estimate);
    if (seen.time_s - this.trailAt >= TRAIL_EVERY_S) {
      this.trailAt = seen.time_s;
      this.trail.push(seen.position);
      if (this.trail.length > TRAIL) this.trail.shift();
    }
  }

  draw(seconds) {
    const seen = this.newest;
    if (!seen || !this.vehicle) return;
    const share = 1 - Math.exp(-seconds / SMOOTH_S), half = (this.headingOff ?? 0) / 2;
    const estimate = seen.estimate ? times([Math.cos(half), 0, 0, Math.sin(half)], unit(seen.estimate)) : seen.attitude;
    const before = this.shown ?? { position: seen.position, attitude: seen.attitude, estimate, heading: headingOf(seen.attitude), turned: seen.turned, eye: null };
    this.shown = {
      position: mix(before.position, seen.position, share), attitude: between(before.attitude, seen.attitude, share),
      estimate: between(before.estimate, estimate, share), heading: before.heading, eye: before.eye,
      turned: mix(before.turned, seen.turned, share),
    };
    this.place(seconds, seen);
    this.look(seconds);
    const began = performance.now();
    this.renderer.render({ scene: this.root, camera: this.camera });
    this.judge(performance.now() - began, seconds);
  }

  place(seconds, { motors, wind, estimate, rivals, happening }) {
    const { position, attitude, estimate: guessed } = this.shown, [x, y, z] = position;
    this.vehicle.pose(position, attitude);
    const half = headingOf(attitude) / 2;
    this.below.pose(position, [Math.cos(half), 0, 0, Math.sin(half)]);
    this.vehicle.turn(motors, seconds);
    for (const one of [this.vehicle, this.below, this.shadow.vehicle, ...Object.values(this.ghosts)]) one.set(this.shown.turned, happening);
    for (const [name, ghost] of Object.entries(this.ghosts)) {
      ghost.visible = this.wanted.has(name) && Boolean(name === "estimate" ? estimate : rivals[name]);
      if (ghost.visible) ghost.pose(position, name === "estimate" ? guessed : leaned(attitude, rivals[name]));
    }
    this.shadow.vehicle.pose(position, attitude);
    this.stalk.position.set(x, y, z / 2);
    this.stalk.rotation.x = Math.PI / 2;
    this.stalk.scale.y = Math.max(z, 0.001);
    this.stalk.visible = z > 0.4;
    this.dome.position.set(x, y, 0);
    this.field.position.set(Math.round(x / 10) * 10, Math.round(y / 10) * 10, 0);
    const [east, north] = wind ?? [0, 0, 0], size = Math.hypot(...(wind ?? [0])), long = 0.07 * size;
    this.arrow.visible = size > 0.3;
    this.arrow.position.set(x, y, z + 0.45);
    this.arrow.rotation.z = Math.atan2(north, east) - Math.PI / 2;
    this.shaft.scale.y = long;
    this.head.position.y = long / 2 + 0.05;
    const drawn = this.trail.length - NOT_YET;  // the picture is a little late
    for (let at = 0; at < TRAIL; at++) this.points.set(at < drawn ? this.trail[at] : position, 3 * at);
    this.line.geometry.attributes.position.needsUpdate = true;
  }

  look(seconds) {
    const shown = this.shown, [x, y, z] = shown.position, share = 1 - Math.exp(-seconds / CAMERA_S);
    const turn = headingOf(shown.attitude) - shown.heading;
    shown.heading += Math.atan2(Math.sin(turn), Math.cos(turn)) * share;
    if (this.view !== 1) this.zoom(WIDE_DEG);
    const [c, s] = [Math.cos(shown.heading), Math.sin(shown.heading)];
    if (this.view === 1) {
      const away = Math.hypot(x - STAND[0], y - STAND[1], z - STAND[2]);
      this.zoom(Math.min(Math.max(2 * Math.atan(FIELD_M / away) / DEG, NARROW_DEG), WIDE_DEG));
      this.eye(STAND, [x, y, z]);
    } else if (this.view === 2) {
      this.vehicle.updateMatrixWorld();
      const m = this.vehicle.matrix, at = (fx, fz) => [x + fx * m[0] + fz * m[8], y + fx * m[1] + fz * m[9], z + fx * m[2] + fz * m[10]];
      this.camera.up.set(m[8], m[9], m[10]);
      this.eye(at(0.1, 0.06), at(2, 0.06));
      return;
    } else {
      const wanted = [x - this.away * c, y - this.away * s, Math.max(z + UP * this.away, 0.35)];
      shown.eye = shown.eye ? mix(shown.eye, wanted, Math.min(1, 1.6 * share)) : wanted;
      this.eye(shown.eye, [x + 0.35 * c, y + 0.35 * s, z + 0.12]);
    }
    this.camera.up.set(0, 0, 1);
  }

  zoom(degrees) {
    if (degrees !== this.camera.fov) this.camera.perspective({ fov: degrees, aspect: this.camera.aspect });
  }

  eye(from, to) {
    this.camera.position.set(...from);
    this.camera.lookAt(to);
  }

  // A machine that draws slowly gets fewer pixels.
  judge(took, seconds) {
    this.slow = 0.9 * this.slow + 0.1 * Math.max(took, 1000 * Math.min(seconds, 0.2));
    this.frames += 1;
    if (this.frames < FRAMES_TO_JUDGE || this.slow < SLOW_MS || this.dpr <= LEAST_DPR) return;
    this.dpr = Math.max(this.dpr * 0.75, LEAST_DPR);
    this.frames = 0;
    this.resize();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    this.renderer.dpr = this.dpr;
    this.renderer.setSize(width, height);
    this.camera.perspective({ aspect: width / Math.max(height, 1) });
  }
}
