// The panel of kept views and notes: kept, opened, ordered, saved as a file, and played as a path.

import { downloadBytes } from '../downloads.js';
import { element } from '../formats.js';
import { framesThrough, keptText, keptView, readFile } from './kept_file.js';
import { fromWire, toFile } from '../view_state.js';

const $ = (id) => document.getElementById(id);
const FRAMES_PER_S = 30;
/// Largest file that is read, in bytes.
const LARGEST = 64 << 20;

export class KeptPanel {
  /// `app` has live, kept, history, measure, player, drawing, share, tell(SENTENCE), wholeView(), showView(VIEW), which
  /// shows a kept view, and hit(): the HIT that the page shows, or null.
  constructor(app) {
    Object.assign(this, app);
    const uses = {
      'kept-add': () => this.add(), 'note-add': () => this.addNote(), 'kept-save': () => this.save(), 'kept-open': () => $('kept-file').click(),
      'path-play': () => this.play(), 'path-save': () => this.savePath(), 'view-open': () => $('kept-file').click(), 'kept-close': () => this.onClose(),
    };
    for (const [id, use] of Object.entries(uses)) $(id).addEventListener('click', use);
    for (const [field, use] of [['kept-name', () => this.add()], ['note-text', () => this.addNote()]]) {
      $(field).addEventListener('keydown', ({ key }) => key === 'Enter' && use());
    }
    $('kept-file').addEventListener('change', async ({ target }) => {
      const [file] = target.files;
      if (file) this.open(file.size > LARGEST ? null : await file.text().catch(() => null), file.name);
      target.value = '';
    });
  }

  get isOpen() { return !$('kept').hidden; }
  setOpen(isOpen) {
    $('kept').hidden = !isOpen;
    this.show();
  }

  /// Replaces views and notes, as a step that can be taken back.
  put(content) {
    this.history.note();
    this.kept.put({ ...this.kept.content, ...content });
  }

  // --- Views and notes

  add() {
    if (!this.live.view) return;
    const { views } = this.kept.content, name = $('kept-name').value.trim() || `View ${views.length + 1}`;
    $('kept-name').value = '';
    const added = { name: name.slice(0, 200), view: keptView(this.wholeView()), measures: this.measure.list };
    this.put({ views: [...views.filter((other) => other.name !== added.name), added] });
    this.tell(`The view “${added.name}” is kept in this browser.`);
  }

  /// Adds a note at the point that was clicked last.
  addNote() {
    const text = $('note-text').value.trim(), hit = this.hit();
    if (!text) return $('note-text').focus();
    if (!hit) return this.tell('Click the point of the note first.');
    $('note-text').value = '';
    this.put({ notes: [...this.kept.content.notes, { text: text.slice(0, 10000), point: hit.position, view: keptView(this.wholeView()) }] });
  }

  showKept({ view, measures }) {
    this.history.note();
    if (measures) this.measure.restore(measures);
    this.showView(view);
  }

  show() {
    const { views, notes } = this.kept.content;
    const label = (number, point) => [{ kind: 'dot', points: [point], style: 'note' }, { kind: 'label', points: [point], style: 'note', text: String(number) }];
    this.drawing.set('notes', notes.flatMap(({ point }, i) => label(i + 1, point)));
    if (!this.isOpen) return;
    $('kept-views').replaceChildren(...views.map((view, i) => this.viewRow(view, i)));
    $('kept-notes').replaceChildren(...notes.map((note, i) => this.noteRow(note, i)));
    $('kept-save').disabled = views.length + notes.length === 0;
    $('path-play').disabled = $('path-save').disabled = views.length < 2;
    $('path-help').hidden = views.length >= 2;
  }

  button(text, name, use, isOff = false) {
    const made = element('button', { type: 'button', className: 'small', title: name, disabled: isOff }, text);
    made.setAttribute('aria-label', name);
    made.addEventListener('click', use);
    return made;
  }

  viewRow(view, i) {
    const { views } = this.kept.content;
    const swap = (j) => () => this.put({ views: views.with(i, views[j]).with(j, view) });
    const go = element('button', { type: 'button', className: 'go' }, view.name);
    go.addEventListener('click', () => this.showKept(view));
    return element('li', {}, go, this.button('↑', `Move ${view.name} up`, swap(i - 1), i === 0),
      this.button('↓', `Move ${view.name} down`, swap(i + 1), i === views.length - 1),
      this.button('×', `Remove ${view.name}`, () => this.put({ views: views.toSpliced(i, 1) })));
  }

  noteRow(note, i) {
    const go = element('button', { type: 'button', className: 'go' }, `${i + 1}. ${note.text}`);
    go.addEventListener('click', () => this.showKept(note));
    return element('li', {}, go, this.button('×', `Remove note ${i + 1}`, () => this.put({ notes: this.kept.content.notes.toSpliced(i, 1) })));
  }

  // --- Files

  save() {
    downloadBytes([keptText(this.kept.content, this.live.scene)], 'application/json', `${this.share.name}.kept.json`);
    this.tell('The views and notes are saved.');
  }

  /// Opens the text of a file; null: it cannot be read.
  open(text, name) {
    const read = text === null ? { error: 'The file cannot be read.' } : readFile(text);
    if (read.error) return this.tell(`${name}: ${read.error}`);
    if (read.view) {
      this.history.note();
      return this.showView(read.view);
    }
    if (read.path) return this.playFrames(read.path.frames, read.path.view);
    this.put(read.kept);
    const { views, notes } = read.kept, isOther = read.scene_id !== undefined && read.scene_id !== this.live.scene.scene_id;
    this.tell(`${views.length} views and ${notes.length} notes are opened.${isOther ? ' They were made with another model.' : ''}`);
  }

  // --- Paths

  /// The frames through the kept views, as long as the field says for each step.
  frames() {
    const seconds = Number($('path-seconds').value), { views } = this.kept.content;
    const count = Math.max(1, Math.round((seconds > 0 ? Math.min(seconds, 3600) : 1) * FRAMES_PER_S));
    return framesThrough(views.map(({ view }) => fromWire(view.camera)), count, this.live.upAxis);
  }

  /// The look of a path is that of its first view.
  get look() { return this.kept.content.views[0].view; }

  play() {
    if (this.player.isOn) return this.player.stop();
    this.playFrames(this.frames(), this.look);
  }

  playFrames(frames, view) {
    this.history.note();
    if (view) this.showView({ ...view, camera: frames[0] });
    this.player.play(frames, FRAMES_PER_S);
  }

  savePath() {
    const { camera, ...view } = this.look, frames = this.frames().map((frame) => toFile({ camera: frame }).camera);
    downloadBytes([JSON.stringify({ view, frames }), '\n'], 'application/json', `${this.share.name}.path.json`);
    this.tell(`The path is saved: ${frames.length.toLocaleString('en')} frames. quarry render --camera-path renders it.`);
  }
}
