// The line that describes the picture, and the details below it.

import { describe } from './frame.js';
import { bytes, compact, fillList, milliseconds, shown } from './formats.js';

const $ = (id) => document.getElementById(id);
/// Time between two updates of the rates; faster ones cannot be read.
const RATES_MS = 250;
/// A state that lasts this long is announced to screen readers: a picture in motion changes often.
const SPOKEN_MS = 700;

const CONNECTIONS = {
  connecting: 'connecting', open: 'connected', lost: 'looking for the master', denied: 'no access', refused: 'refused', outdated: 'version mismatch',
};

export class Hud {
  constructor(live, picture) {
    this.live = live;
    this.picture = picture;
    this.connection = 'connecting';
    this.times = null;  // queue, trace and encode of the frame that gave the latency
    $('status').addEventListener('click', () => {
      const isOpen = $('details').hidden;
      $('details').hidden = !isOpen;
      $('status').setAttribute('aria-expanded', String(isOpen));
      this.showRates();
    });
    setInterval(() => this.showRates(), RATES_MS);
  }

  setConnection(state) {
    this.connection = state;
    this.show();
  }

  /// Whether the frame on the screen shows the newest view.
  get isNewest() {
    return this.live.isSent && this.picture.header?.input === this.live.input;
  }

  /// Handles a drawn frame.
  drawn(header) {
    if (header.input !== this.times?.input) {
      const { input, queue_ms: queue, trace_ms: trace, encode_ms: encode } = header;
      this.times = { input, queue, trace, encode };
    }
    this.show();
  }

  show() {
    const { header } = this.picture;
    const isOpen = this.connection === 'open';
    const said = !isOpen ? { text: CONNECTIONS[this.connection], kind: 'lost' }
      : header ? describe(header, this.isNewest, this.live.isMoving) : { text: 'waiting for the first picture', kind: 'moving' };
    if ($('status-text').textContent !== said.text) $('status-text').textContent = said.text;
    $('status-dot').className = `dot ${said.kind}`;
    this.speak(!isOpen ? said.text : said.kind === 'exact' ? 'The picture is exact.' : 'The picture is changing.');
  }

  /// Gives screen readers each lasting state once.
  speak(sentence) {
    if (sentence === this.sentence) return;
    this.sentence = sentence;
    clearTimeout(this.speaking);
    this.speaking = setTimeout(() => { $('spoken').textContent = sentence; }, SPOKEN_MS);
  }

  showRates() {
    this.show();
    const rates = this.picture.rates();
    const latency = this.picture.latency;
    const answered = Number.isFinite(latency ?? NaN) ? `answers in ${milliseconds(latency)}` : '';
    $('status-rates').textContent = rates.frames === 0 ? answered : `${rates.frames.toFixed(rates.frames < 10 ? 1 : 0)} frames/s · ${answered}`;
    const { queue, trace, encode } = this.times ?? {};
    const split = this.times ? `waiting ${milliseconds(queue)}, rendering ${milliseconds(trace)}, encoding ${milliseconds(encode)}, `
      + `transfer and drawing ${milliseconds(Math.max(0, latency - queue - trace - encode))}` : '–';
    $('status').title = `From your move to the picture: ${milliseconds(latency ?? NaN)} (${split})`;
    if (!$('details').hidden) this.showDetails(rates, split);
  }

  showDetails(rates, split) {
    const { header } = this.picture, { scene } = this.live;
    fillList($('details'), [
      ['Model', scene && `${shown(scene.name)}, ${compact(scene.triangles)} triangles, ${compact(scene.voxels)} voxels`],
      ['Connection', CONNECTIONS[this.connection]],
      ['Latency', `${milliseconds(this.picture.latency ?? NaN)}: ${split}`],
      ['Picture', header && `${header.size.join(' × ')}, ${header.samples} of ${header.spp} samples`],
      ['Pixels', header && `${Math.floor(header.traced * 100)} % traced${header.waiting > 0 ? `, ${header.waiting.toLocaleString('en')} wait for data` : ''}`],
      ['Exposure', header && Number.isFinite(header.exposure) ? `${header.exposure.toFixed(2)} EV` : null],
      ['Light', this.live.lightNames],
      ['Transfer', `${bytes(rates.bytes)}/s`],
    ]);
  }
}
