// The gizmo of axes and the scale bar: how the picture is turned, and how large things in it are.

import { axes, pixelSize } from '../camera.js';
import { roundLength, withUnit } from './units.js';
import { svg } from './drawing.js';

const $ = (id) => document.getElementById(id);
const NAMES = ['x', 'y', 'z'];
const ARM = 22, MIDDLE = 32;  // CSS pixels
/// Longest scale bar, CSS pixels.
const LONGEST = 110;

export class Gizmo {
  /// `depth()`: of the things that the scale bar measures, in scene units.
  constructor(live, depth) {
    this.live = live;
    this.depth = depth;
    this.arms = NAMES.map((name) => {
      const line = svg('line', { class: name, x1: MIDDLE, y1: MIDDLE }), label = svg('text', { class: name });
      label.textContent = name;
      $('axes').append(line, label);
      return { line, label };
    });
  }

  place() {
    const { camera, size, scene } = this.live;
    if (!camera || !scene) return;
    $('compass').hidden = false;
    const own = axes(camera);
    const ends = this.arms.map((arm, axis) => ({ ...arm, right: own.right[axis], up: own.up[axis], ahead: own.forward[axis] }));
    for (const { line, label, right, up } of ends) {
      line.setAttribute('x2', (MIDDLE + ARM * right).toFixed(1));
      line.setAttribute('y2', (MIDDLE - ARM * up).toFixed(1));
      label.setAttribute('x', (MIDDLE + (ARM + 7) * right).toFixed(1));
      label.setAttribute('y', (MIDDLE - (ARM + 7) * up).toFixed(1));
    }
    // Arms that point toward the eye are drawn over the others.
    ends.sort((a, b) => b.ahead - a.ahead);
    const order = ends.map(({ line }) => line.getAttribute('class')).join('');
    if (order !== this.order) $('axes').append(...ends.flatMap(({ line, label }) => [line, label]));
    this.order = order;
    this.placeScale(pixelSize(camera, size, this.depth()) * size[0] / $('stage').clientWidth);
  }

  /// `pixel`: scene units that a CSS pixel covers.
  placeScale(pixel) {
    const length = roundLength(LONGEST * pixel);
    $('scale-bar').style.width = `${(length / pixel).toFixed(1)}px`;
    const text = withUnit(length, this.live.scene.unit_in_metres);
    if ($('scale-text').textContent !== text) $('scale-text').textContent = text;
  }
}

