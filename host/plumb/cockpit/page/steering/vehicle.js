// The vehicle, from the solids that its system declares: as it is, as it is estimated, and its shadow.

import { Box, Cylinder, Mesh, Transform } from "./ogl.min.js";
import { solid } from "./shader.js";

const BLADE_M = 0.004, ROUND = 24, SPIN_RADPS = 34, DISC_ALPHA = 0.22, TURNS = 0.02, GHOST_ORDER = -0.5;

export const rgb = (text) => [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255);

function geometryOf(gl, { kind, size_m: size }) {
  if (kind === "box") return new Box(gl, { width: size[0], height: size[1], depth: size[2] });
  if (kind === "wheel") return new Cylinder(gl, { radiusTop: size[0], radiusBottom: size[0], height: size[1], radialSegments: ROUND });
  if (kind === "propeller") return new Box(gl, { width: 2 * size[0], height: size[1], depth: BLADE_M });
  return new Cylinder(gl, { radiusTop: size[0], radiusBottom: size[0], height: size[1], radialSegments: ROUND });
}

// paint: the program of a colour.
export class Vehicle extends Transform {
  constructor(gl, shapes, paint, { discs = null } = {}) {
    super();
    this.blades = [];
    this.discs = [];
    this.turned = [];
    this.parts = [];  // those that an event brings or takes away
    for (const shape of shapes) {
      const holder = new Transform(), mesh = new Mesh(gl, { geometry: geometryOf(gl, shape), program: paint(shape.colour) });
      if (shape.kind === "cylinder") mesh.rotation.x = Math.PI / 2;  // its axis is y
      holder.position.set(...shape.at_m);
      holder.rotation.z = shape.turn_rad;
      mesh.setParent(holder);
      holder.setParent(this);
      if (shape.without || shape.during) this.parts.push({ holder, ...shape });
      if (shape.kind !== "propeller") {
        if (shape.motor >= 0) this.turned.push({ mesh, motor: shape.motor });
        continue;
      }
      this.blades.push({ holder, motor: shape.motor, spin: shape.spin });
      if (!discs) continue;
      const disc = new Mesh(gl, {
        geometry: new Cylinder(gl, { radiusTop: shape.size_m[0], radiusBottom: shape.size_m[0], height: 0.001, radialSegments: 32 }),
        program: discs(shape.colour),
      });
      disc.rotation.x = Math.PI / 2;
      disc.setParent(holder);
      this.discs.push({ disc, motor: shape.motor });
    }
  }

  // place: [x, y, z]; attitude: w, x, y, z.
  pose(place, [w, x, y, z]) {
    this.position.set(...place);
    this.quaternion.set(x, y, z, w);
  }

  // angles: of the parts that motors turn, in rad; happening: the events that are on.
  set(angles, happening) {
    for (const { mesh, motor } of this.turned) mesh.rotation.y = angles[motor] ?? 0;
    for (const { holder, without, during } of this.parts) holder.visible = !happening.includes(without) && (!during || happening.includes(during));
  }

  turn(motors, seconds) {
    for (const { holder, motor, spin } of this.blades) {
      if (motors[motor] > TURNS) holder.rotation.z += spin * SPIN_RADPS * (0.4 + motors[motor]) * seconds;
    }
    for (const { disc, motor } of this.discs) disc.visible = motors[motor] > TURNS;
  }
}

export function solidVehicle(gl, haze, shapes) {
  const paint = (colour) => solid(gl, haze, rgb(colour));
  return new Vehicle(gl, shapes, paint, { discs: (colour) => solid(gl, haze, rgb(colour), { alpha: DISC_ALPHA, lit: 0 }) });
}

export function ghostVehicle(gl, haze, shapes, colour) {
  const program = solid(gl, haze, colour, { alpha: 0.5, lit: 0.4, behind: true }), ghost = new Vehicle(gl, shapes.filter(({ during }) => !during), () => program);
  ghost.traverse((part) => { part.renderOrder = GHOST_ORDER; });
  return ghost;
}

// Lies flat on the ground: its parent is squeezed along z.
export function shadowVehicle(gl, haze, shapes, colour) {
  const program = solid(gl, haze, colour, { lit: 0 }), flat = new Transform(), vehicle = new Vehicle(gl, shapes.filter(({ during }) => !during), () => program);
  flat.scale.set(1, 1, 0.0005);
  flat.position.z = 0.004;
  vehicle.setParent(flat);
  return { flat, vehicle };
}
