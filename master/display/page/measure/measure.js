// Measuring: clicks become distances, angles and clearances, which are drawn over the picture and listed in a card.

import { element } from '../formats.js';
import { lengthText, unitName } from '../marks/units.js';
import { along, mix } from '../vectors.js';
import { legsOf, partsOf, POINTS, snapped, valueOf } from './snap.js';

const $ = (id) => document.getElementById(id);
/// How near to the cursor a corner or an edge must be seen to be taken, CSS pixels.
const REACH = 10;
/// How far from its face a ray along the normal begins, in sizes of the scene: more than the error of a hit.
const LEAVE_FACE = 1e-6;
const HELP = {
  distance: 'Click two points. Corners and edges are taken when they are near.',
  angle: 'Click three points: the angle is at the second one.',
  normal: 'Click a face: the distance along its normal to the next surface.',
};
const NAMES = { distance: 'Distance', angle: 'Angle', normal: 'From a face' };
const AXES = ['x', 'y', 'z'];

export class Measure {
  /// `app` has live, drawing, history, tell(SENTENCE), and onChange(), which runs when it is turned on or off.
  constructor(app) {
    Object.assign(this, app);
    this.isOn = false;
    this.kind = 'distance';
    this.list = [];
    this.begun = [];  // points of the measurement under way
    this.hovered = null;
    this.isAsking = false;
    $('measure-kinds').addEventListener('change', ({ target }) => this.setKind(target.value));
    $('measure-clear').addEventListener('click', () => this.replace([]));
    $('measure-close').addEventListener('click', () => this.setOn(false));
  }

  setOn(isOn) {
    this.isOn = isOn;
    $('measure').hidden = !isOn;
    this.begun = [];
    this.hovered = null;
    this.show();
    this.onChange();
  }

  setKind(kind) {
    this.kind = kind;
    this.begun = [];
    this.show();
  }

  /// Replaces all measurements, as a step that can be taken back.
  replace(list) {
    this.history.note();
    this.restore(list);
  }

  restore(list) {
    this.list = list;
    this.show();
  }

  /// The place under a pixel: {hit, point, kind}, or null.
  async placeAt(x, y) {
    const { live } = this, hit = await live.pick(x, y);
    if (!hit || !live.view) return null;
    const reach = $('measure-snap').checked && this.kind !== 'normal' ? REACH * live.size[0] / $('stage').clientWidth : 0;
    return { hit, ...snapped(hit, live.camera, live.size, x, y, reach) };
  }

  /// Takes the point under a pixel.
  async click(x, y) {
    const place = await this.placeAt(x, y);
    if (!this.isOn) return;
    if (!place) return this.tell('There is no surface.');
    if (this.kind === 'normal') return this.alongNormal(place.hit);
    this.begun.push(place.point);
    this.hovered = null;
    if (this.begun.length < POINTS[this.kind]) return this.show();
    this.finish({ kind: this.kind, points: this.begun });
  }

  /// Measures from a face along its normal to the next surface.
  async alongNormal({ position, normal }) {
    const next = await this.live.pickAlong(along(position, normal, LEAVE_FACE * this.live.scene.size), normal);
    if (!next) return this.tell('Along the normal of this face there is no other surface.');
    this.finish({ kind: 'normal', points: [position, next.position] });
  }

  finish(measurement) {
    this.begun = [];
    this.replace([...this.list, measurement]);
    this.tell(this.text(measurement));
  }

  /// Shows the point that a click would take. One question at a time.
  async hover(x, y) {
    if (this.isAsking || !this.isOn) return;
    this.isAsking = true;
    const place = await this.placeAt(x, y);
    this.isAsking = false;
    this.hovered = this.isOn && place;
    this.draw();
  }

  /// Drops the points of a measurement under way. Returns whether there were any.
  dropBegun() {
    const had = this.begun.length > 0;
    this.begun = [];
    this.show();
    return had;
  }

  get unit() { return unitName(this.live.scene?.unit_in_metres ?? 1); }

  valueText(measurement) {
    const value = valueOf(measurement);
    if (!Number.isFinite(value)) return '–';
    return measurement.kind === 'angle' ? `${value.toFixed(2)}°` : `${lengthText(value)}\u00a0${this.unit}`;
  }

  /// A measurement in one line.
  text(measurement) {
    const value = `${NAMES[measurement.kind]}: ${this.valueText(measurement)}`;
    if (measurement.kind === 'angle') return value;
    return `${value} (${partsOf(measurement).map((part, axis) => `${AXES[axis]} ${lengthText(part)}`).join(', ')})`;
  }

  show() {
    $('measure-help').textContent = HELP[this.kind];
    for (const choice of $('measure-kinds').querySelectorAll('input')) choice.checked = choice.value === this.kind;
    $('measure-list').replaceChildren(...this.list.map((measurement, i) => this.row(measurement, i)));
    $('measure-clear').hidden = this.list.length === 0;
    this.draw();
  }

  row(measurement, i) {
    const remove = element('button', { type: 'button', className: 'small', title: 'Remove' }, '×');
    remove.setAttribute('aria-label', `Remove measurement ${i + 1}`);
    remove.addEventListener('click', () => this.replace(this.list.filter((other) => other !== measurement)));
    return element('li', {}, element('span', {}, this.text(measurement)), remove);
  }

  draw() {
    const shapes = this.list.flatMap((measurement) => this.shapes(measurement));
    const ends = [...this.begun, ...(this.hovered ? [this.hovered.point] : [])];
    if (this.begun.length > 0 && ends.length > 1) shapes.push({ kind: 'line', points: ends, style: 'begun' });
    for (const point of this.begun) shapes.push({ kind: 'dot', points: [point], style: 'begun' });
    if (this.hovered) shapes.push({ kind: 'dot', points: [this.hovered.point], style: `hovered ${this.hovered.kind}` });
    this.drawing.set('measures', shapes);
  }

  shapes(measurement) {
    const { kind, points } = measurement, label = (at) => ({ kind: 'label', points: [at], text: this.valueText(measurement) });
    const ends = points.map((point) => ({ kind: 'dot', points: [point] }));
    const line = { kind: 'line', points, style: 'measured' };
    if (kind === 'angle') return [line, ...ends, label(points[1])];
    if (kind === 'normal') return [line, ...ends, label(mix(...points, 0.5))];
    const corners = legsOf(points);
    const legs = AXES.map((axis, i) => ({ kind: 'line', points: corners.slice(i, i + 2), style: `leg ${axis}` }));
    return [...legs, line, ...ends, label(mix(...points, 0.5))];
  }
}
