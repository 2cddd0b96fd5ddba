// Snapping, and the arithmetic of measurements. Pure functions, no DOM, double precision.

import { isOrthographic, project } from '../camera.js';
import { cross, distance, dot, length, mix, subtract } from '../vectors.js';

/// The point of a line from a to b that is seen nearest to a pixel position: {point, away}; away in pixels. Null if an
/// end lies behind the eye.
function nearestOnEdge(camera, size, a, b, x, y) {
  const from = project(camera, size, a), to = project(camera, size, b);
  if (!from || !to) return null;
  const dx = to.x - from.x, dy = to.y - from.y, squared = dx * dx + dy * dy;
  const s = squared > 0 ? Math.min(1, Math.max(0, ((x - from.x) * dx + (y - from.y) * dy) / squared)) : 0;
  // A perspective shortens what is far: the share along the line is weighed by the depths of its ends.
  const t = isOrthographic(camera) ? s : s * from.depth / (s * from.depth + (1 - s) * to.depth);
  return { point: mix(a, b, t), away: Math.hypot(from.x + s * dx - x, from.y + s * dy - y) };
}

/// The point of a HIT, moved to the corner or the edge of its triangle that is seen within `reach` pixels of the pixel
/// position: {point, kind}; kind is 'corner', 'edge' or 'face'. A corner goes before an edge.
export function snapped(hit, camera, size, x, y, reach) {
  const corners = hit.corners ?? [];
  const nearest = (list) => list.filter((found) => found && found.away <= reach).sort((a, b) => a.away - b.away)[0];
  const corner = nearest(corners.map((point) => {
    const seen = project(camera, size, point);
    return seen && { point, away: Math.hypot(seen.x - x, seen.y - y) };
  }));
  if (corner) return { point: corner.point, kind: 'corner' };
  const edge = nearest(corners.map((a, i) => nearestOnEdge(camera, size, a, corners[(i + 1) % corners.length], x, y)));
  return edge ? { point: edge.point, kind: 'edge' } : { point: hit.position, kind: 'face' };
}

/// A measurement is {kind, points}: 'distance' and 'normal' have two points, 'angle' three, with its vertex second.
export const POINTS = { distance: 2, angle: 3, normal: 2 };

/// The angle at b, in degrees; NaN where two points are the same.
export function angleAt([a, b, c]) {
  const one = subtract(a, b), other = subtract(c, b);
  if (!(length(one) > 0 && length(other) > 0)) return NaN;
  return Math.atan2(length(cross(one, other)), dot(one, other)) * 180 / Math.PI;
}

/// The value of a measurement: a length, or an angle in degrees.
export const valueOf = ({ kind, points }) => (kind === 'angle' ? angleAt(points) : distance(points[0], points[1]));

/// The parts of a distance along x, y and z.
export const partsOf = ({ points: [a, b] }) => subtract(b, a).map(Math.abs);

/// The legs of a distance along the axes, as a line from its first point to its second.
export function legsOf([a, b]) {
  return [a, [b[0], a[1], a[2]], [b[0], b[1], a[2]], b];
}

/// Whether something from a file is a measurement.
export function isMeasurement(given) {
  return POINTS[given?.kind] !== undefined && Array.isArray(given.points) && given.points.length === POINTS[given.kind]
    && given.points.every((point) => Array.isArray(point) && point.length === 3 && point.every(Number.isFinite));
}
