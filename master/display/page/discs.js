// The preview's discs, drawn by WebGL: a point of each disc's size, cut to the ellipse that the disc shows.
// The bytes of ./discs: see PROTOCOL.md.

import { axes, isOrthographic, tangentOf } from './camera.js';

const MAGIC = 0x31435351, HEADER_BYTES = 72, DISC_BYTES = 24;
/// Smallest point in pixels: finer discs would leave holes.
const LEAST_PIXELS = 2;

const VERTEX = `#version 300 es
uniform mat3 turn;
uniform vec3 eye;
uniform vec2 lens;   // half the picture's width and height at depth 1, or in scene units with a flat camera
uniform vec3 range;  // nearest and farthest depth; 1 with a flat camera
uniform vec2 size;   // of the picture, pixels
in vec3 centre; in float radius; in vec3 normal; in vec3 colour;
out vec3 facing, tint;
out float pixels;
void main() {
  vec3 p = turn * (centre - eye);
  float depth = -p.z, away = range.z > 0.5 ? 1.0 : depth;
  float z = range.z > 0.5 ? 2.0 * (depth - range.x) / (range.y - range.x) - 1.0
    : (range.y + range.x) / (range.y - range.x) - 2.0 * range.y * range.x / ((range.y - range.x) * depth);
  gl_Position = vec4(p.xy / lens, z * away, away);
  pixels = max(radius / lens.y / away * size.y, ${LEAST_PIXELS}.0);
  gl_PointSize = pixels;
  facing = turn * normal;
  tint = colour;
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec3 facing, tint;
in float pixels;
out vec4 colour;
void main() {
  vec3 n = facing.z < 0.0 ? -facing : facing;
  vec2 q = (gl_PointCoord * 2.0 - 1.0) * vec2(1.0, -1.0);
  float rise = dot(q, n.xy) / max(n.z, 0.05);
  if (pixels > 3.0 && dot(q, q) + rise * rise > 1.0) discard;
  colour = vec4(tint * (0.35 + 0.65 * n.z), 1.0);
}`;

/// The header of ./discs, and its discs: {count, triangles, part, upAxis, lower, upper, offset,
/// bytes}. Null: they are none.
export function readDiscs(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < HEADER_BYTES || view.getUint32(0, true) !== MAGIC) return null;
  const count = view.getUint32(4, true);
  if (buffer.byteLength < HEADER_BYTES + count * DISC_BYTES) return null;
  const point = (at) => [0, 1, 2].map((axis) => view.getFloat32(at + 4 * axis, true));
  return {
    count, triangles: Number(view.getBigUint64(8, true)), part: view.getFloat32(16, true), upAxis: view.getUint32(20, true) === 1 ? 'y' : 'z',
    lower: point(24), upper: point(36), offset: [48, 56, 64].map((at) => view.getFloat64(at, true)), bytes: new Uint8Array(buffer, HEADER_BYTES, count * DISC_BYTES),
  };
}

export class Discs {
  /// Throws where there is no WebGL 2.
  constructor(canvas) {
    this.canvas = canvas;
    const gl = this.gl = canvas.getContext('webgl2', { antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error('no WebGL 2');
    const program = this.program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    const attribute = (name, count, type, at) => {
      const place = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, count, type, type !== gl.FLOAT, DISC_BYTES, at);
    };
    attribute('centre', 3, gl.FLOAT, 0);
    attribute('radius', 1, gl.FLOAT, 12);
    attribute('normal', 3, gl.BYTE, 16);
    attribute('colour', 3, gl.UNSIGNED_BYTE, 20);
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(0.084, 0.09, 0.102, 1);
    this.count = 0;
  }

  set(discs) {
    this.gl.bufferData(this.gl.ARRAY_BUFFER, discs.bytes, this.gl.DYNAMIC_DRAW);
    Object.assign(this, { count: discs.count, lower: discs.lower, upper: discs.upper });
  }

  /// Draws a camera of the page (camera.js), size in pixels.
  draw(camera, [width, height]) {
    const { gl, canvas, program } = this;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const { right, up, forward } = axes(camera);
    const isFlat = isOrthographic(camera), half = isFlat ? camera.ortho / 2 : tangentOf(camera);
    const depths = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => [0, 1, 2].reduce(
      (sum, axis) => sum + ((i >> axis & 1 ? this.upper : this.lower)[axis] - camera.eye[axis]) * forward[axis], 0));
    const far = Math.max(...depths, 1e-6) * 1.01, least = isFlat ? Math.min(...depths) - 0.01 * far : far * 1e-4;
    const near = isFlat ? least : Math.max(Math.min(...depths) * 0.99, least);
    const set = (kind, name, ...values) => gl[`uniform${kind}`](gl.getUniformLocation(program, name), ...values);
    set('Matrix3fv', 'turn', false, [0, 1, 2].flatMap((axis) => [right[axis], up[axis], -forward[axis]]));
    set('3f', 'eye', ...camera.eye);
    set('2f', 'lens', half * width / height, half);
    set('3f', 'range', near, far, isFlat ? 1 : 0);
    set('2f', 'size', width, height);
    gl.viewport(0, 0, width, height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.drawArrays(gl.POINTS, 0, this.count);
  }
}
