// Cameras: projection, and the moves orbit, pan, dolly, look and fly. Pure functions, no DOM, double precision.
//
// A camera is {eye, at, up, fov, ortho}: positions in scene units, fov in degrees (vertical), ortho the height of an
// orthographic picture in scene units, or missing. `at` lies ahead of the eye; its distance is the view distance.
// A size is [width, height] in pixels, a pixel position counts from the picture's upper left corner; the centre of
// the first pixel is (0.5, 0.5). The formulas of the picture are the same as in common/scene/view_basis.h.

import { add, along, cross, distance, dot, length, mix, scale, subtract, unit } from './vectors.js';

/// Steepest look with the scene's up axis as the camera's up vector; beyond it, the heading is the up vector. Radians.
const STEEP = 89 * Math.PI / 180;
const POLE = Math.PI / 2;

export const isOrthographic = (camera) => camera.ortho > 0;
export const tangentOf = (camera) => Math.tan(camera.fov * Math.PI / 360);
export const viewDistance = (camera) => distance(camera.eye, camera.at);
export const upVector = (upAxis) => (upAxis === 'y' ? [0, 1, 0] : [0, 0, 1]);

/// The camera's unit axes.
export function axes(camera) {
  const forward = unit(subtract(camera.at, camera.eye));
  const right = unit(cross(forward, camera.up));
  return { right, up: cross(right, forward), forward };
}

/// Scene units that a pixel covers at `depth` ahead of the eye.
export function pixelSize(camera, size, depth) {
  return (isOrthographic(camera) ? camera.ortho : 2 * tangentOf(camera) * depth) / size[1];
}

/// The ray of a pixel position: {origin, direction}; direction is a unit vector.
export function rayOf(camera, size, x, y) {
  const { right, up, forward } = axes(camera);
  const pixel = pixelSize(camera, size, 1);
  const across = add(scale(right, (x - size[0] / 2) * pixel), scale(up, (size[1] / 2 - y) * pixel));
  return isOrthographic(camera) ? { origin: add(camera.eye, across), direction: forward }
    : { origin: camera.eye, direction: unit(add(forward, across)) };
}

/// The distance of a point ahead of the eye, along the direction of view.
export function depthOf(camera, point) {
  return dot(subtract(point, camera.eye), unit(subtract(camera.at, camera.eye)));
}

/// The point at `depth` under a pixel position.
export function pointAt(camera, size, x, y, depth) {
  const ray = rayOf(camera, size, x, y);
  return along(ray.origin, ray.direction, depth / dot(ray.direction, unit(subtract(camera.at, camera.eye))));
}

/// A point's place in the picture: {x, y, depth}, or null when it lies behind a perspective camera.
export function project(camera, size, point) {
  const { right, up, forward } = axes(camera);
  const offset = subtract(point, camera.eye);
  const depth = dot(offset, forward);
  if (!isOrthographic(camera) && !(depth > 0)) return null;
  const pixel = pixelSize(camera, size, depth);
  return { x: size[0] / 2 + dot(offset, right) / pixel, y: size[1] / 2 - dot(offset, up) / pixel, depth };
}

/// The direction of view as a turntable's {heading, pitch}, radians. A camera that looks along the scene's up
/// axis takes its heading from its right vector.
export function turntable(camera, upAxis) {
  const up = upVector(upAxis);
  const { right, forward } = axes(camera);
  const rise = dot(forward, up);
  let level = along(forward, up, -rise);
  const pitch = Math.atan2(rise, length(level));
  if (length(level) < 1e-3) level = cross(up, right);
  const [east, north] = compass(upAxis);
  return { heading: Math.atan2(dot(level, east), dot(level, north)), pitch };
}

/// Two horizontal directions at right angles, from which headings are measured.
function compass(upAxis) {
  return upAxis === 'y' ? [[1, 0, 0], [0, 0, -1]] : [[1, 0, 0], [0, 1, 0]];
}

/// The upright unit axes of a heading and pitch, with the up vector that a camera of that direction has.
export function uprightAxes(heading, pitch, upAxis) {
  const up = upVector(upAxis);
  const [east, north] = compass(upAxis);
  const level = add(scale(east, Math.sin(heading)), scale(north, Math.cos(heading)));
  const forward = add(scale(level, Math.cos(pitch)), scale(up, Math.sin(pitch)));
  const right = cross(level, up);
  return { right, up: cross(right, forward), forward,
           upVector: Math.abs(pitch) <= STEEP ? up : scale(level, -Math.sign(pitch)) };
}

const clampPitch = (pitch) => Math.min(POLE, Math.max(-POLE, pitch));

/// Turns the camera around `pivot`, which keeps its place in the picture. `yaw` turns about the scene's up axis,
/// `pitch` about the camera's right; the look stops at the poles. The result is upright. Radians.
export function orbit(camera, pivot, yaw, pitch, upAxis) {
  const before = axes(camera);
  const look = turntable(camera, upAxis);
  const after = uprightAxes(look.heading + yaw, clampPitch(look.pitch + pitch), upAxis);
  const offset = subtract(camera.eye, pivot);
  const eye = add(pivot, add(scale(after.right, dot(offset, before.right)),
    add(scale(after.up, dot(offset, before.up)), scale(after.forward, dot(offset, before.forward)))));
  return { ...camera, eye, at: along(eye, after.forward, viewDistance(camera)), up: after.upVector };
}

/// Turns the camera about its eye. Radians.
export const look = (camera, yaw, pitch, upAxis) => orbit(camera, camera.eye, yaw, pitch, upAxis);

/// Moves eye and view by a vector.
export function moved(camera, by) {
  return { ...camera, eye: add(camera.eye, by), at: add(camera.at, by) };
}

/// Moves the camera across its picture so that `point` appears at a pixel position. Requires: the point lies ahead.
export function pan(camera, size, point, x, y) {
  return moved(camera, subtract(point, pointAt(camera, size, x, y, depthOf(camera, point))));
}

/// Moves the camera nearer to `point` (factor below 1) or farther; the point keeps its place in the picture. An
/// orthographic camera changes its height instead.
export function dolly(camera, size, point, factor) {
  if (isOrthographic(camera)) {
    const seen = project(camera, size, point);
    return pan({ ...camera, ortho: camera.ortho * factor }, size, point, seen.x, seen.y);
  }
  const forward = unit(subtract(camera.at, camera.eye));
  const eye = mix(point, camera.eye, factor);
  return { ...camera, eye, at: along(eye, forward, viewDistance(camera) * factor) };
}

/// Moves the eye along the camera's right, the scene's up and the direction of view. Scene units.
export function fly(camera, right, up, forward, upAxis) {
  const own = axes(camera);
  return moved(camera, add(scale(own.right, right), add(scale(upVector(upAxis), up), scale(own.forward, forward))));
}

/// The orthographic camera that shows things at `depth` as large as the perspective one does.
export function toOrthographic(camera, depth) {
  return isOrthographic(camera) ? camera : { ...camera, ortho: 2 * tangentOf(camera) * depth };
}

/// The perspective camera that shows things at `depth` as large as the orthographic one does.
export function toPerspective(camera, depth) {
  if (!isOrthographic(camera)) return camera;
  const forward = unit(subtract(camera.at, camera.eye));
  const away = camera.ortho / (2 * tangentOf(camera));
  const eye = along(camera.eye, forward, depth - away);
  const { ortho, ...rest } = camera;
  return { ...rest, eye, at: along(eye, forward, away) };
}

/// Centres `point` in the picture, at the same distance.
export function centred(camera, size, point) {
  const there = depthOf(camera, point) > 0 ? pan(camera, size, point, size[0] / 2, size[1] / 2) : camera;
  return { ...there, at: along(there.eye, unit(subtract(point, there.eye)), distance(point, there.eye)) };
}

/// The camera that looks at the same point from the other side.
export function opposite(camera) {
  return { ...camera, eye: camera.eye.map((x, i) => 2 * camera.at[i] - x) };
}

/// A camera for pictures of 4:3, moved back so that a narrower picture shows as much.
export function fitAspect(camera, size) {
  const factor = Math.max(1, (4 / 3) * size[1] / size[0]);
  if (factor === 1) return camera;
  if (isOrthographic(camera)) return { ...camera, ortho: camera.ortho * factor };
  return { ...camera, eye: along(camera.at, subtract(camera.eye, camera.at), factor) };
}

/// The eight corners of a box.
function corners(lower, upper) {
  return Array.from({ length: 8 }, (_, i) => [0, 1, 2].map((axis) => (i >> axis & 1 ? upper : lower)[axis]));
}

/// The camera with the same direction that shows the whole box, as large as the picture allows.
export function frameBox(camera, size, lower, upper) {
  const own = axes(camera);
  const points = corners(lower, upper);
  const most = (value) => Math.max(...points.map(value));
  const diagonal = Math.max(distance(lower, upper), 1e-9);
  const middle = mix(lower, upper, 0.5);
  const free = 0.95, aspect = size[0] / size[1];
  const extent = (direction) => most((p) => Math.abs(dot(subtract(p, middle), direction)));
  if (isOrthographic(camera)) {
    const ortho = Math.max(2 * Math.max(extent(own.up), extent(own.right) / aspect) / free, diagonal * 1e-6);
    return { ...camera, ortho, eye: along(middle, own.forward, -diagonal), at: middle };
  }
  const tangent = tangentOf(camera) * free;
  // The least distance from the middle at which every corner lies inside the four planes through the picture's edges.
  const away = Math.max(...points.map((p) => {
    const offset = subtract(p, middle);
    const aside = Math.max(Math.abs(dot(offset, own.right)) / aspect, Math.abs(dot(offset, own.up)));
    return aside / tangent - dot(offset, own.forward);
  }), diagonal * 1e-3);
  return { ...camera, eye: along(middle, own.forward, -away), at: middle };
}

/// An orthographic camera outside a box, moved back until the whole box lies ahead of it; its picture is the same, and
/// nothing is cut off. A camera inside the box is not moved; its plane then cuts the model.
export function aheadOfBox(camera, lower, upper) {
  const isInside = camera.eye.every((x, i) => x >= lower[i] && x <= upper[i]);
  if (!isOrthographic(camera) || isInside) return camera;
  const forward = unit(subtract(camera.at, camera.eye));
  const nearest = Math.min(...corners(lower, upper).map((p) => depthOf(camera, p)));
  const margin = distance(lower, upper) * 0.01;
  return nearest >= margin ? camera : { ...camera, eye: along(camera.eye, forward, nearest - margin) };
}

/// A camera between two, at t in [0, 1]. The direction takes the shorter way round; the ends are exact.
export function between(from, to, t, upAxis) {
  if (t <= 0) return from;
  if (t >= 1 || isOrthographic(from) !== isOrthographic(to)) return to;
  const a = turntable(from, upAxis), b = turntable(to, upAxis);
  const turn = Math.atan2(Math.sin(b.heading - a.heading), Math.cos(b.heading - a.heading));
  const { forward, upVector: up } = uprightAxes(a.heading + turn * t, a.pitch + (b.pitch - a.pitch) * t, upAxis);
  const away = viewDistance(from) ** (1 - t) * viewDistance(to) ** t;
  const at = mix(from.at, to.at, t);
  const camera = { ...to, at, eye: along(at, forward, -away), up, fov: from.fov + (to.fov - from.fov) * t };
  if (isOrthographic(to)) camera.ortho = from.ortho ** (1 - t) * to.ortho ** t;
  return camera;
}

/// Rounds positions to a ten-thousand-millionth of the scene's size, so that links are short and exact.
export function rounded(camera, sceneSize) {
  const step = 10 ** (Math.floor(Math.log10(sceneSize > 0 ? sceneSize : 1)) - 10);
  const places = Math.max(0, Math.min(100, Math.round(-Math.log10(step))));
  const round = (v) => v.map((x) => Number(x.toFixed(places)));
  const shape = (x) => Number(x.toPrecision(12));
  const camera2 = { ...camera, eye: round(camera.eye), at: round(camera.at), up: camera.up.map(shape),
                    fov: shape(camera.fov) };
  if (isOrthographic(camera)) camera2.ortho = shape(camera.ortho);
  return camera2;
}
