// Plots of the last minute, drawn on canvases.

import { element } from './formats.js';

export const SPAN_S = 60;
const INK = '#9aa3ad', GRID = '#ffffff1a', LEFT = 'rgb(240 130 110 / 0.7)', JOINED = 'rgb(120 210 150 / 0.7)';
/// Longest time between two samples that a line joins, s. Statistics arrive once a second.
const GAP_S = 3.5;

/// The next number of 1, 2, 5, 10, ... that is not below `value`.
function roundUp(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((x) => x * power).find((x) => x >= value * (1 - 1e-9));
}

export class Plot {
  /// `value(sample)` is the number to draw, `format(number)` its text; `most`: fixed upper end of the axis.
  constructor({ title, colour, value, format, most }) {
    Object.assign(this, { colour, value, format, most });
    this.now = element('span', { className: 'now' });
    this.canvas = element('canvas', { role: 'img' });
    this.title = title;
    this.element = element('figure', {}, element('figcaption', {}, title, this.now), this.canvas);
  }

  /// Draws samples ({at, ...}, at in seconds) up to the time `end`; `events`: [{at, joined}].
  draw(samples, events, end) {
    const context = this.fit();
    if (!context) return;
    const { width, height } = this.box, values = samples.map(this.value);
    const top = this.most ?? roundUp(Math.max(0, ...values.filter(Number.isFinite)));
    const x = (at) => (1 - (end - at) / SPAN_S) * width;
    const foot = this.text + 4;
    const y = (value) => height - foot - Math.min(1, value / top) * (height - foot - 4);
    this.drawGrid(context, top, y);
    for (const { at, joined } of events) {
      context.fillStyle = joined ? JOINED : LEFT;
      context.fillRect(x(at) - 0.5, 4, 1.5, height - foot - 4);
    }
    this.drawLine(context, samples, values, x, y);
    const last = values.at(-1);
    this.now.textContent = Number.isFinite(last) ? this.format(last) : '–';
    this.canvas.setAttribute('aria-label', `${this.title} of the last minute, now ${this.now.textContent}`);
  }

  /// Gives the canvas the size of its place in device pixels. Returns its context, or null while it has no place.
  fit() {
    const ratio = devicePixelRatio, width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    if (!width || !height) return null;
    this.box = { width, height };
    this.text = parseFloat(getComputedStyle(document.documentElement).fontSize) * 0.72;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    const context = this.canvas.getContext('2d');
    context.scale(ratio, ratio);
    return context;
  }

  drawGrid(context, top, y) {
    const { width, height } = this.box;
    context.fillStyle = GRID;
    for (const share of [0, 0.5, 1]) context.fillRect(0, Math.round(y(top * share)), width, 1);
    context.fillStyle = INK;
    context.font = `${this.text}px system-ui, sans-serif`;
    context.textBaseline = 'top';
    context.fillText(this.format(top), 2, y(top) + 3);
    context.fillText('60 s ago', 2, height - this.text - 1);
    context.textAlign = 'right';
    context.fillText('now', width - 2, height - this.text - 1);
  }

  drawLine(context, samples, values, x, y) {
    context.strokeStyle = this.colour;
    context.lineWidth = 1.5;
    context.lineJoin = 'round';
    context.beginPath();
    let before = -Infinity;
    samples.forEach(({ at }, i) => {
      if (!Number.isFinite(values[i])) return;
      if (at - before > GAP_S) context.moveTo(x(at), y(values[i]));
      else context.lineTo(x(at), y(values[i]));
      before = at;
    });
    context.stroke();
  }
}
