// Sections as data: a box and planes that cut the model open. Pure functions, no DOM, double precision.
//
// A section is {box: [lower, upper], planes: [{point, normal}], caps}; box and planes may be missing. Kept is the inside
// of the box and the side of each plane against its normal.

import { cornerOf } from '../marks/drawing.js';
import { along, cross, dot, length, mix, scale, subtract, unit } from '../vectors.js';

export const MOST_PLANES = 12;

/// How far along the line through `point` in `direction` the place lies that a ray passes nearest, in lengths of
/// `direction`. Null where the ray runs along the line.
export function nearestOnLine(point, direction, ray) {
  const between = subtract(ray.origin, point), a = dot(direction, direction), b = dot(direction, ray.direction), c = dot(ray.direction, ray.direction);
  const apart = a * c - b * b;
  return apart > 1e-6 * a * c ? (c * dot(direction, between) - b * dot(ray.direction, between)) / apart : null;
}

/// The middle of a box's side: `side` 0 is the lower one of the axis, 1 the upper one.
export function sideMiddle(box, axis, side) {
  const middle = mix(box[0], box[1], 0.5);
  middle[axis] = box[side][axis];
  return middle;
}

/// The box with one side moved; it keeps at least the thickness `least`.
export function withSide(box, axis, side, value, least) {
  const moved = box.map((corner) => [...corner]);
  moved[side][axis] = side === 0 ? Math.min(value, box[1][axis] - least) : Math.max(value, box[0][axis] + least);
  return moved;
}

/// The part that two boxes share; one of them may be null. Null where they share nothing.
export function sharedBox(a, b) {
  if (!a || !b) return a ?? b;
  const lower = a[0].map((x, i) => Math.max(x, b[0][i])), upper = a[1].map((x, i) => Math.min(x, b[1][i]));
  return lower.every((x, i) => x <= upper[i]) ? [lower, upper] : null;
}

/// A box a little larger, with round numbers: faces that lie in the cut itself would be cut or not by rounding.
export function roundedOut([lower, upper]) {
  const step = 10 ** (Math.floor(Math.log10(length(subtract(upper, lower)) || 1)) - 3);
  const round = (x, to) => Number((to(x / step) * step).toPrecision(12));
  return [lower.map((x) => round(x - step / 2, Math.floor)), upper.map((x) => round(x + step / 2, Math.ceil))];
}

/// The corners of the polygon in which a plane cuts a box, in their order around it.
export function planeInBox({ point, normal }, box) {
  const ends = Array.from({ length: 8 }, (_, corner) => cornerOf(box, corner));
  const heights = ends.map((end) => dot(subtract(end, point), normal));
  const found = [];
  for (let from = 0; from < 8; ++from) {
    for (const bit of [1, 2, 4]) {
      const to = from | bit;
      if (to === from || (heights[from] < 0) === (heights[to] < 0)) continue;
      found.push(mix(ends[from], ends[to], heights[from] / (heights[from] - heights[to])));
    }
  }
  if (found.length < 3) return [];
  const middle = scale(found.reduce((sum, p) => along(sum, p, 1), [0, 0, 0]), 1 / found.length);
  const right = unit(subtract(found[0], middle)), up = cross(unit(normal), right);
  const turn = (p) => Math.atan2(dot(subtract(p, middle), up), dot(subtract(p, middle), right));
  return found.sort((a, b) => turn(a) - turn(b));
}

const isPoint = (point) => Array.isArray(point) && point.length === 3 && point.every(Number.isFinite);

/// A section from a file or a link, or undefined where it is not valid.
export function sectionOf(given) {
  if (given === null || typeof given !== 'object') return undefined;
  const { box, planes, caps } = given;
  const isBox = box === undefined || (Array.isArray(box) && box.length === 2 && box.every(isPoint) && box[0].every((x, i) => x < box[1][i]));
  const arePlanes = planes === undefined || (Array.isArray(planes) && planes.length <= MOST_PLANES
    && planes.every((plane) => isPoint(plane?.point) && isPoint(plane.normal) && length(plane.normal) > 0));
  if (!isBox || !arePlanes || (box === undefined && !planes?.length)) return undefined;
  return { ...(box && { box }), ...(planes?.length && { planes }), caps: caps !== false };
}
