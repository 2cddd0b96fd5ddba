// The section of the view: a box and planes, moved by handles in the picture or by typed numbers in a card.

import { element } from '../formats.js';
import { lengthText } from '../marks/units.js';
import { rayOf } from '../camera.js';
import { along, dot, scale, unit } from '../vectors.js';
import { MOST_PLANES, nearestOnLine, planeInBox, roundedOut, sectionOf, sideMiddle, withSide } from './cut.js';

const $ = (id) => document.getElementById(id);
const AXES = ['x', 'y', 'z'], SIDES = ['from', 'to'];
/// Least thickness of a box, and the distance of a plane before its face, in sizes of the scene: a face that lies in
/// the plane itself would be cut or not by rounding.
const THINNEST = 1e-6, BEFORE_FACE = 1e-6;

export class Section {
  /// `app` has live, drawing, history, tell(SENTENCE), box(): the box of the parts that are shown, and onChange(), which
  /// runs when the card opens or closes.
  constructor(app) {
    Object.assign(this, app);
    this.fields = AXES.map((name, axis) => SIDES.map((word, side) => this.field(axis, side, `${name} ${word}`)));
    AXES.forEach((name, axis) => $('section-box').append(element('span', {}, name), ...this.fields[axis]));
    $('section-box-on').addEventListener('change', ({ target }) => this.change({ box: target.checked ? roundedOut(this.box()) : undefined }));
    $('section-caps').addEventListener('change', ({ target }) => this.change({ caps: target.checked }));
    $('section-remove').addEventListener('click', () => this.put(undefined));
    $('section-close').addEventListener('click', () => this.setOpen(false));
  }

  get isOpen() { return !$('section').hidden; }
  get section() { return this.live.view?.section; }

  /// Opens or closes the card and the handles. A model without a section gets a box around its shown parts.
  setOpen(isOpen) {
    $('section').hidden = !isOpen;
    if (isOpen && !this.section) this.change({ box: roundedOut(this.box()) });
    this.show();
    this.onChange();
  }

  /// Replaces the section, as a step that can be taken back.
  put(section) {
    this.history.note();
    this.live.change({ section });
  }

  /// Replaces members of the section; one without box and planes is none.
  change(members) {
    this.put(this.changed(members));
  }

  changed(members) { return sectionOf({ caps: true, ...this.section, ...members }); }

  /// Adds a plane at the face of a HIT: what lies before the face is cut away.
  atFace({ position, normal }) {
    const planes = this.section?.planes ?? [];
    if (planes.length >= MOST_PLANES) return this.tell(`A section has at most ${MOST_PLANES} planes.`);
    this.change({ planes: [...planes, { point: along(position, normal, BEFORE_FACE * this.live.scene.size), normal }] });
    this.setOpen(true);
  }

  // --- Typed numbers

  field(axis, side, name) {
    const made = element('input', { type: 'number', step: 'any' });
    made.setAttribute('aria-label', name);
    made.addEventListener('change', () => {
      const value = made.value === '' ? NaN : Number(made.value);
      const box = this.section?.box;
      if (box && Number.isFinite(value)) this.change({ box: withSide(box, axis, side, value, this.thinnest) });
      this.show();
    });
    return made;
  }

  get thinnest() { return THINNEST * this.live.scene.size; }

  planeRow({ point, normal }, i) {
    const place = element('input', { type: 'number', step: 'any', value: lengthText(dot(point, unit(normal))) });
    place.setAttribute('aria-label', `Plane ${i + 1}: place along its normal`);
    place.addEventListener('change', () => {
      const value = place.value === '' ? NaN : Number(place.value);
      if (Number.isFinite(value)) this.changePlane(i, { point: along(point, unit(normal), value - dot(point, unit(normal))), normal });
      else this.show();
    });
    const button = (text, name, use) => {
      const made = element('button', { type: 'button', className: 'small', title: name }, text);
      made.setAttribute('aria-label', `${name}: plane ${i + 1}`);
      made.addEventListener('click', use);
      return made;
    };
    const direction = unit(normal).map((x) => Number(x.toFixed(3))).join(', ');
    return element('li', { title: `Normal ${direction}` }, element('span', {}, `Plane ${i + 1}`), place,
      button('⇄', 'Keep the other side', () => this.changePlane(i, { point, normal: scale(normal, -1) })),
      button('×', 'Remove', () => this.changePlane(i)));
  }

  /// Replaces a plane, or removes it.
  changePlane(i, ...plane) { this.change({ planes: this.section.planes.toSpliced(i, 1, ...plane) }); }

  // --- What is shown

  /// Makes card and handles show the section of the view.
  show() {
    const { section } = this;
    $('tool-section').setAttribute('aria-pressed', String(section !== undefined));
    this.draw();
    if (!this.isOpen) return;
    $('section-box-on').checked = Boolean(section?.box);
    $('section-box').hidden = !section?.box;
    $('section-caps').checked = section?.caps ?? true;
    $('section-remove').disabled = !section;
    this.fields.forEach((pair, axis) => pair.forEach((field, side) => {
      if (section?.box && document.activeElement !== field) field.value = lengthText(section.box[side][axis]);
    }));
    const text = JSON.stringify(section?.planes ?? []);
    if (this.planesShown === text) return;
    this.planesShown = text;
    $('section-planes').replaceChildren(...(section?.planes ?? []).map((plane, i) => this.planeRow(plane, i)));
  }

  draw() {
    const { section } = this, shapes = [];
    if (section && this.isOpen) {
      const { box, planes = [] } = section;
      if (box) shapes.push({ kind: 'box', points: box, style: 'cut' });
      for (const plane of planes) shapes.push({ kind: 'loop', points: planeInBox(plane, box ?? this.box()), style: 'cut' });
      if (box) AXES.forEach((name, axis) => SIDES.forEach((_, side) => shapes.push(this.sideHandle(box, axis, side))));
      planes.forEach((plane, i) => shapes.push(this.planeHandle(plane, i)));
    }
    this.drawing.set('section', shapes.filter(({ points }) => points.length > 0));
  }

  sideHandle(box, axis, side) {
    return { kind: 'handle', points: [sideMiddle(box, axis, side)], style: `side ${AXES[axis]}${side}`,
             bind: (made) => this.bindHandle(made, () => this.sideDrag(axis, side)) };
  }

  planeHandle({ point }, i) {
    return { kind: 'handle', points: [point], style: `plane p${i}`, bind: (made) => this.bindHandle(made, () => this.planeDrag(i)) };
  }

  // --- Drags

  /// A drag is {point, direction, put(distance)}: along a line through a point, by multiples of `direction`.
  sideDrag(axis, side) {
    const { box } = this.section, direction = [0, 0, 0];
    direction[axis] = 1;
    return { point: sideMiddle(box, axis, side), direction,
             put: (by) => this.changed({ box: withSide(box, axis, side, box[side][axis] + by, this.thinnest) }) };
  }

  planeDrag(i) {
    const { planes } = this.section, { point, normal } = planes[i], direction = unit(normal);
    return { point, direction, put: (by) => this.changed({ planes: planes.with(i, { point: along(point, direction, by), normal }) }) };
  }

  bindHandle(made, begin) {
    let drag = null;
    const placeOf = (event) => nearestOnLine(drag.point, drag.direction, this.rayAt(event));
    made.addEventListener('pointerdown', (event) => {
      if (event.button !== 0 || !this.section) return;
      event.preventDefault();
      event.stopPropagation();
      made.setPointerCapture(event.pointerId);
      drag = begin();
      drag.from = placeOf(event) ?? 0;
      this.history.note();
      this.live.hold('section');
    });
    made.addEventListener('pointermove', (event) => {
      if (!drag) return;
      event.stopPropagation();
      const to = placeOf(event);
      if (to !== null) this.live.change({ section: drag.put(to - drag.from) });
    });
    const end = (event) => {
      if (!drag) return;
      event.stopPropagation();
      drag = null;
      this.live.release('section');
    };
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) made.addEventListener(name, end);
  }

  rayAt({ clientX, clientY }) {
    const box = $('stage').getBoundingClientRect(), { camera, size } = this.live;
    return rayOf(camera, size, (clientX - box.left) / box.width * size[0], (clientY - box.top) / box.height * size[1]);
  }
}
