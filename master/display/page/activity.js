// The drawer with the cluster's activity: live plots and the workers, as they join and leave.

import { workerColour } from './colours.js';
import { bytes, compact, duration, element, percent, shown } from './formats.js';
import { Plot, SPAN_S } from './plots.js';

const $ = (id) => document.getElementById(id);
/// Seconds for which a worker is marked as new, and for which a worker that has left stays listed.
const NEWS_S = 20;

const PLOTS = [
  { title: 'Frames', colour: '#7fb4ff', value: (s) => s.frames_per_s, format: (x) => `${compact(x)}/s` },
  { title: 'Loaded', colour: '#f0b45c', value: (s) => s.voxel_bytes_loaded_per_s, format: (x) => `${bytes(x)}/s` },
  { title: 'Rays', colour: '#8fd6a6', value: (s) => s.rays_per_s, format: (x) => `${compact(x)}/s` },
  { title: 'Cache hits', colour: '#d59cf0', value: (s) => s.cache_hit_rate, format: percent, most: 1 },
];

export class Activity {
  constructor() {
    this.samples = [];
    this.workers = new Map();  // by id: {facts, since, left}
    this.events = [];
    this.isFirst = true;
    this.plots = PLOTS.map((options) => new Plot(options));
    $('plots').append(...this.plots.map((plot) => plot.element));
    new ResizeObserver(() => this.draw()).observe($('plots'));
  }

  get isOpen() { return !$('activity').hidden; }

  setOpen(isOpen) {
    $('activity').hidden = !isOpen;
    this.draw();
  }

  /// Forgets the workers of the earlier master.
  restart() { this.isFirst = true; }

  /// Takes the server's statistics.
  take(stats) {
    const at = performance.now() / 1000;
    this.stats = stats;
    this.samples.push({ ...stats, at });
    this.samples = this.samples.filter((sample) => sample.at > at - SPAN_S - 2);
    this.takeWorkers(stats.workers ?? [], at);
    this.events = this.events.filter((event) => event.at > at - SPAN_S);
    this.draw();
  }

  takeWorkers(present, at) {
    const ids = new Set(present.map(({ id }) => id));
    for (const [id, worker] of this.workers) {
      if (!ids.has(id) && worker.left === null) {
        worker.left = at;
        this.events.push({ at, joined: false });
      }
      if (worker.left !== null && at - worker.left > NEWS_S) this.workers.delete(id);
    }
    for (const facts of present) {
      const known = this.workers.get(facts.id);
      if (known && known.left === null) {
        known.facts = facts;
        continue;
      }
      this.workers.set(facts.id, { facts, since: this.isFirst ? -Infinity : at, left: null });
      if (!this.isFirst) this.events.push({ at, joined: true });
    }
    this.isFirst = false;
  }

  draw() {
    if (!this.isOpen || !this.stats) return;
    const now = performance.now() / 1000, end = this.samples.at(-1).at, { stats } = this;
    for (const plot of this.plots) plot.draw(this.samples, this.events, end);
    const present = [...this.workers.values()].filter(({ left }) => left === null);
    const many = (n, word) => `${n} ${word}${n === 1 ? '' : 's'}`;
    $('activity-summary').textContent = [many(present.length, 'worker'), many(stats.viewers, 'viewer'),
      `${compact(stats.rays_suspended_per_s)} rays/s wait for data`, `running for ${duration(stats.up_s)}`].join(' · ');
    $('workers').replaceChildren(...[...this.workers.entries()].sort(([a], [b]) => a - b).map(([id, worker]) => row(id, worker, now)));
  }
}

/// A worker's row in the list.
function row(id, { facts, since, left }, now) {
  const load = left === null ? Math.min(1, Math.max(0, facts.load)) : 0;
  const swatch = element('span', { className: 'swatch' });
  swatch.style.background = workerColour(id);
  const fill = element('span', { className: 'fill' });
  fill.style.width = `${load * 100}%`;
  fill.style.background = workerColour(id);
  const news = left !== null ? 'left' : now - since < NEWS_S ? 'joined' : '';
  const says = left !== null ? 'has left' : `${percent(load)} · ${compact(facts.rays_per_s)} rays/s · ${bytes(facts.voxel_bytes_loaded_per_s)}/s`;
  const made = element('div', { className: `worker ${news}`, title: `${facts.threads} threads, ${bytes(facts.cache_resident_bytes)} cached` },
    swatch, element('span', { className: 'name' }, shown(facts.name)), element('span', { className: 'news' }, news === 'joined' ? 'joined' : ''),
    element('span', { className: 'bar' }, fill), element('span', { className: 'numbers' }, says));
  made.setAttribute('role', 'listitem');
  return made;
}
