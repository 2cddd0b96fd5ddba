// Marks over the picture: lines, boxes, dots and labels at places of the scene. They follow the view, and are never a
// part of the picture.
//
// A shape is {kind, points, style, text, bind}: kind is 'line' (an open line through the points), 'loop' (a closed
// one), 'box' (points are its lower and upper corner), 'dot', 'handle' or 'label' (at the first point). `style` is a
// class of the style sheet. `bind(element)` runs once for the element of a handle.

import { depthOf, isOrthographic, project } from '../camera.js';
import { mix } from '../vectors.js';

const SPACE = 'http://www.w3.org/2000/svg';
/// Least depth of a drawn point before a perspective eye, in depths of the line's farther end.
const NEAREST = 1e-4;
/// Edges of a box: its corners, by bits for x, y, z.
const BOX_EDGES = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/// An SVG element with attributes.
export function svg(name, attributes = {}) {
  const made = document.createElementNS(SPACE, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

/// The corner of a box: `corner` has a bit for each axis, set for the upper side.
export const cornerOf = ([lower, upper], corner) => [0, 1, 2].map((axis) => (corner >> axis & 1 ? upper : lower)[axis]);

/// The part of a line that lies before the eye, or null. Perspective only: an orthographic line is whole.
export function beforeEye(camera, a, b) {
  if (isOrthographic(camera)) return [a, b];
  const from = depthOf(camera, a), to = depthOf(camera, b), least = NEAREST * Math.max(Math.abs(from), Math.abs(to));
  if (from < least && to < least) return null;
  if (from >= least && to >= least) return [a, b];
  const cut = mix(a, b, (least - from) / (to - from));
  return from < least ? [cut, b] : [a, cut];
}

/// The straight lines of a shape, as pairs of points.
function linesOf({ kind, points }) {
  if (kind === 'box') return BOX_EDGES.map((ends) => ends.map((corner) => cornerOf(points, corner)));
  const closed = kind === 'loop' ? [...points, points[0]] : points;
  return closed.slice(1).map((point, i) => [closed[i], point]);
}

export class Drawing {
  /// Draws in `element`, an <svg> that covers the stage.
  constructor(element, live) {
    this.element = element;
    this.live = live;
    this.groups = new Map();  // by name: {group, shapes, elements}
    new ResizeObserver(() => this.place()).observe(element);
  }

  /// Replaces the shapes of one name. Elements of shapes that keep their kind and style stay: a handle that moves is
  /// still dragged.
  set(name, shapes) {
    if (!this.groups.has(name)) {
      const group = svg('g', { class: name });
      this.element.append(group);
      this.groups.set(name, { group, shapes: [], elements: [] });
    }
    const drawn = this.groups.get(name);
    shapes.forEach((shape, i) => {
      const before = drawn.shapes[i];
      if (before && before.kind === shape.kind && before.style === shape.style) return;
      const made = this.make(shape);
      if (drawn.elements[i]) drawn.elements[i].replaceWith(made);
      else drawn.group.append(made);
      drawn.elements[i] = made;
    });
    for (const left of drawn.elements.splice(shapes.length)) left.remove();
    drawn.shapes = shapes;
    this.place();
  }

  make({ kind, style = '', bind }) {
    const names = { dot: 'circle', handle: 'circle', label: 'text' };
    const made = svg(names[kind] ?? 'path', { class: `${kind} ${style}` });
    if (kind === 'dot') made.setAttribute('r', '4');
    if (kind === 'handle') made.setAttribute('r', '9');
    bind?.(made);
    return made;
  }

  /// Follows the view.
  place() {
    if (!this.live.view || !this.live.scene) return;
    for (const { shapes, elements } of this.groups.values()) shapes.forEach((shape, i) => this.placeOne(shape, elements[i]));
  }

  /// The place of a point in CSS pixels, or null behind the eye.
  at(point) {
    const { camera, size } = this.live, seen = project(camera, size, point);
    return seen && { x: seen.x / size[0] * this.element.clientWidth, y: seen.y / size[1] * this.element.clientHeight };
  }

  placeOne(shape, made) {
    if (made.localName === 'path') return made.setAttribute('d', this.drawn(linesOf(shape)));
    const seen = this.at(shape.points[0]);
    made.toggleAttribute('hidden', !seen);
    if (!seen) return;
    const round = made.localName === 'circle';
    made.setAttribute(round ? 'cx' : 'x', seen.x.toFixed(1));
    made.setAttribute(round ? 'cy' : 'y', seen.y.toFixed(1));
    if (made.textContent !== (shape.text ?? '')) made.textContent = shape.text ?? '';
  }

  drawn(lines) {
    const parts = [];
    for (const line of lines) {
      const [a, b] = (beforeEye(this.live.camera, ...line) ?? []).map((point) => this.at(point));
      if (a && b) parts.push(`M${a.x.toFixed(1)} ${a.y.toFixed(1)}L${b.x.toFixed(1)} ${b.y.toFixed(1)}`);
    }
    return parts.join('');
  }
}
