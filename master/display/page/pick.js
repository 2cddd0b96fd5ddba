// The answer to a click: a card with the point's facts, and marks that follow their points in the picture.

import { coordinate, copyText, fillList, shown } from './formats.js';
import { project } from './camera.js';

const $ = (id) => document.getElementById(id);

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
    this.mark = mark;
    this.hit = null;
    $('pick-close').addEventListener('click', () => this.close());
    $('pick-copy').addEventListener('click', async () => {
      tell(await copyText(this.text()) ? 'Copied.' : 'The browser did not allow copying.');
    });
  }

  get isOpen() { return !$('pick').hidden; }

  /// Shows a HIT; null closes the card.
  show(hit) {
    if (!hit) return this.close();
    this.hit = hit;
    this.mark.put(hit.position);
    $('pick-title').textContent = shown(hit.part) || 'A part without a name';
    fillList($('pick-facts'), this.rows());
    $('pick').hidden = false;
  }

  rows() {
    const { hit } = this;
    return [
      ['Material', shown(hit.material) || '–'],
      ['Position', hit.position.map(coordinate).join(', ')],
      ['Distance', coordinate(hit.distance)],
      ['Normal', hit.normal?.map((x) => x.toFixed(3)).join(', ')],
      ['Triangle', String(hit.triangle)],
      ['Voxel', String(hit.voxel)],
    ];
  }

  text() {
    return [['Part', shown(this.hit.part)], ...this.rows()].map(([name, value]) => `${name}: ${value}`).join('\n');
  }

  close() {
    $('pick').hidden = true;
    this.hit = null;
    this.mark.put(null);
  }
}
