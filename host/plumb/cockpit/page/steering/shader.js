// The shaders of the scene: earth axes with z up, colours as linear as the screen's, and a haze that hides the edge of the
// ground.

import { Program } from "./ogl.min.js";

const VERTEX = `#version 300 es
in vec3 position;
in vec3 normal;
uniform mat4 modelMatrix, viewMatrix, projectionMatrix;
out vec3 place, outward;
void main() {
  vec4 at = modelMatrix * vec4(position, 1.0);
  place = at.xyz;
  outward = mat3(modelMatrix) * normal;
  gl_Position = projectionMatrix * viewMatrix * at;
}`;

const HEAD = `#version 300 es
precision highp float;
in vec3 place, outward;
uniform vec3 cameraPosition, haze;
out vec4 shown;
vec3 hazy(vec3 colour) {
  float away = length(place - cameraPosition);
  return mix(haze, colour, exp(-away * away / 16000.0));
}`;

const SOLID = `${HEAD}
uniform vec3 colour;
uniform float alpha, lit;
void main() {
  float light = 1.0;
  if (lit > 0.0) {
    vec3 up = normalize(outward);
    light = mix(1.0, 0.52 + 0.14 * up.z + 0.46 * max(dot(up, normalize(vec3(0.45, 0.35, 0.82))), 0.0), lit);
  }
  shown = vec4(hazy(colour * light), alpha);
}`;

const SKY = `${HEAD}
uniform vec3 zenith;
void main() {
  float up = clamp(normalize(place - cameraPosition).z, 0.0, 1.0);
  shown = vec4(mix(haze, zenith, 1.0 - exp(-up * 3.2)), 1.0);
}`;

// Squares of 1 m and 10 m, and the place where a flight begins.
const GROUND = `${HEAD}
uniform vec3 colour, line, mark;
float lines(vec2 at, float wide) {
  vec2 off = abs(fract(at - 0.5) - 0.5), soft = fwidth(at);
  vec2 on = 1.0 - smoothstep(vec2(0.0), soft * 1.3 + wide, off);
  return max(on.x, on.y) * clamp(0.6 / max(soft.x, soft.y), 0.0, 1.0);
}
float ring(float radius, float wide) {
  float off = abs(length(place.xy) - radius);
  return 1.0 - smoothstep(wide, wide + fwidth(off) * 1.4, off);
}
void main() {
  float away = length(place.xy - cameraPosition.xy);
  vec3 seen = mix(colour, line, 0.55 * lines(place.xy, 0.008) * exp(-away / 14.0));
  seen = mix(seen, line, 0.8 * lines(place.xy / 10.0, 0.003) * exp(-away / 90.0));
  float cross = max(step(abs(place.x), 0.02), step(abs(place.y), 0.02)) * step(length(place.xy), 0.4);
  seen = mix(seen, mark, 0.85 * max(max(ring(1.2, 0.035), ring(0.75, 0.012)), cross));
  shown = vec4(hazy(seen), 1.0);
}`;

const values = (uniforms) => Object.fromEntries(Object.entries(uniforms).map(([name, value]) => [name, { value }]));

// A program of its own for each colour; haze: shared by all, so that a change of the theme reaches every one.
// behind: drawn before all that is solid, so that it shows only where nothing solid is.
export function solid(gl, haze, colour, { alpha = 1, lit = 1, behind = false } = {}) {
  const program = new Program(gl, {
    vertex: VERTEX, fragment: SOLID, transparent: alpha < 1, depthWrite: alpha >= 1, cullFace: false,
    uniforms: { haze, ...values({ colour, alpha, lit }) },
  });
  if (behind) program.transparent = false;  // blended, but in the order of the solid ones
  return program;
}

export function sky(gl, haze, zenith) {
  return new Program(gl, {
    vertex: VERTEX, fragment: SKY, depthTest: false, depthWrite: false, cullFace: false, uniforms: { haze, zenith },
  });
}

// Its corners are so far away that its depth is too rough for what lies on it: it is drawn first, and hides nothing.
export function ground(gl, haze, colour, line, mark) {
  return new Program(gl, {
    vertex: VERTEX, fragment: GROUND, depthWrite: false, cullFace: false, uniforms: { haze, colour, line, mark },
  });
}
