// The answer to a click: a card with the point's facts, and marks that follow their points in the picture.

import { coordinate, copyText, fillList, shown } from './formats.js';
import { lengthText, unitName } from './marks/units.js';
import { project } from './camera.js';

const $ = (id) => document.getElementById(id);
/// Most attributes of a part that are shown, and most letters of one.
const MOST_ATTRIBUTES = 40, MOST_LETTERS = 300;

/// The attributes of a part as rows of the card.
function attributeRows(attributes) {
  const text = (value) => shown(typeof value === 'string' ? value : JSON.stringify(value));
  const short = (all) => (all.length > MOST_LETTERS ? `${all.slice(0, MOST_LETTERS)}…` : all);
  const rows = Object.entries(attributes).map(([name, value]) => [short(shown(name)), short(text(value))]);
  const more = rows.length - MOST_ATTRIBUTES;
  return more > 0 ? [...rows.slice(0, MOST_ATTRIBUTES), ['…', `${more.toLocaleString('en')} more`]] : rows;
}


/// A mark at a point of the scene.
export class Mark {
  constructor(element, live) {
    this.element = element;
    this.live = live;
    this.point = null;
  }

  put(point) {
    this.point = point;
    this.place();
  }

  /// Follows the view.
  place() {
    const { view } = this.live;
    const seen = this.point && view ? project(view.camera, view.size, this.point) : null;
    this.element.hidden = !seen;
    if (!seen) return;
    this.element.style.left = `${seen.x / view.size[0] * 100}%`;
    this.element.style.top = `${seen.y / view.size[1] * 100}%`;
  }
}

export class PickCard {
  constructor(live, mark, tell) {
    this.live = live;
    this.mark = mark;
    this.hit = null;
    $('pick-close').addEventListener('click', () => this.close());
    $('pick-copy').addEventListener('click', async () => {
      tell(await copyText(this.text()) ? 'Copied.' : 'The browser did not allow copying.');
    });
  }

  get isOpen() { return !$('pick').hidden; }

  /// Shows a HIT; null closes the card. `part`: its part's facts, when they are known.
  show(hit, part = null) {
    if (!hit) return this.close();
    this.hit = hit;
    this.part = part;
    this.mark.put(hit.position);
    $('pick-title').textContent = shown(hit.part) || 'A part without a name';
    fillList($('pick-facts'), this.rows());
    $('pick').hidden = false;
  }

  /// Shows a part that was chosen without a point.
  showPart(part) {
    this.hit = null;
    this.part = part;
    this.mark.put(null);
    $('pick-title').textContent = shown(part.name) || 'A part without a name';
    fillList($('pick-facts'), this.rows());
    $('pick').hidden = false;
  }

  rows() {
    const { hit, part } = this;
    return [
      ['Path', part && part.path !== part.name ? shown(part.path) : null],
      ['Material', hit && (shown(hit.material) || '–')],
      ['Triangles', part?.triangles?.toLocaleString('en')],
      ['Size', part?.box ? this.sizeText(part.box) : null],
      ['Surface', part?.children === 0 && part.closed !== null ? (part.closed ? 'closed' : 'open') : null],
      ...attributeRows(part?.attributes ?? {}),
      ...(hit ? [
        ['Position', hit.position.map(coordinate).join(', ')],
        ['Distance', coordinate(hit.distance)],
        ['Normal', hit.normal?.map((x) => x.toFixed(3)).join(', ')],
        ['Triangle', String(hit.triangle)],
        ['Voxel', String(hit.voxel)],
      ] : []),
    ];
  }

  sizeText([lower, upper]) {
    const sizes = upper.map((x, i) => lengthText(x - lower[i])).join(' × ');
    return `${sizes}\u00a0${unitName(this.live.scene.unit_in_metres)}`;
  }

  text() {
    return [['Part', shown(this.hit?.part ?? this.part.name)], ...this.rows()].filter(([, value]) => value).map(([name, value]) => `${name}: ${value}`).join('\n');
  }

  close() {
    $('pick').hidden = true;
    this.hit = this.part = null;
    this.mark.put(null);
  }
}
