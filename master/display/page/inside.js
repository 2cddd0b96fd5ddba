// Looking inside the model: parts, section, measurements, kept views, and the marks over the picture. Ties them to the
// view and to one another.

import { Drawing } from './marks/drawing.js';
import { Gizmo } from './marks/gizmo.js';
import { History } from './kept/history.js';
import { KeptPanel } from './kept/kept_panel.js';
import { Measure } from './measure/measure.js';
import { Parts } from './parts/parts.js';
import { Player } from './kept/player.js';
import { Section } from './section/section.js';
import { sharedBox } from './section/cut.js';
import { checkedInside, fromWire, INSIDE } from './view_state.js';

const $ = (id) => document.getElementById(id);
/// Members of a view file that the page has itself or cannot show.
const NOT_SHOWN = ['size', 'crop', 'aov'];

export class Inside {
  /// `app` has live, navigation, selections, kept, share, card, tell(SENTENCE), wholeView(), defaults(), replaceView(VIEW), and
  /// onDrawer(NAME), which runs when a drawer has opened or closed by itself.
  constructor(app) {
    Object.assign(this, app);
    this.trial = null;  // a view from outside that the server has not shown yet: {before, input}
    this.isByKeys = false;
    const { live, navigation, share, kept, tell } = this;
    const drawing = this.drawing = new Drawing($('marks'), live);
    this.gizmo = new Gizmo(live, () => navigation.knownDepth());
    const history = this.history = new History(() => this.readState(), (state) => this.writeState(state));
    const box = () => this.shownBox();
    this.section = new Section({ live, drawing, history, tell, box, onChange: () => this.onDrawer('section') });
    this.measure = new Measure({ live, drawing, history, tell, onChange: () => this.measureChanged() });
    this.parts = new Parts({ live, navigation, drawing, history, tell, section: this.section,
                             onRow: (parts) => this.showRow(parts), onClose: () => this.close('parts'), onHidden: () => this.card.close() });
    this.player = new Player(live, () => this.playerChanged());
    this.keptPanel = new KeptPanel({ live, kept, history, drawing, share, tell, measure: this.measure, player: this.player, wholeView: this.wholeView,
                                     showView: (view) => this.showView(view), hit: () => this.card.hit, onClose: () => this.close('kept') });
  }

  /// The drawers, by the names of their buttons.
  get drawers() {
    const { measure } = this;
    return { parts: this.parts, section: this.section, kept: this.keptPanel,
             measure: { get isOpen() { return measure.isOn; }, setOpen: (isOpen) => measure.setOn(isOpen) } };
  }

  close(name) {
    this.drawers[name].setOpen(false);
    this.onDrawer(name);
  }

  // --- Boxes

  /// The box of the parts that are shown.
  shownBox() { return this.selections.box ?? this.live.scene.bounds; }

  /// The box that the frame key shows: of the shown parts, within the section; of the whole model its bulk.
  seenBox() {
    const { scene, view } = this.live, cut = view?.section?.box;
    const bulk = [scene.lower, scene.upper];
    if (!cut && !this.selections.box) return bulk;
    return sharedBox(this.shownBox(), cut) ?? bulk;
  }

  // --- Steps that can be taken back

  readState() {
    const { view } = this.live;
    return { inside: Object.fromEntries(INSIDE.map((name) => [name, view?.[name]])), measures: this.measure.list, kept: this.kept.content };
  }

  writeState({ inside, measures, kept }) {
    this.live.change(inside);
    if (measures !== this.measure.list) this.measure.restore(measures);
    if (kept !== this.kept.content) this.kept.put(kept);
  }

  undo() { this.tell(this.history.undo() ? 'Taken back. Ctrl+Shift+Z does it again.' : 'There is nothing to take back.'); }
  redo() { this.tell(this.history.redo() ? 'Done again.' : 'There is nothing to do again.'); }

  // --- Views from outside

  /// Shows a view from a file, or a kept one. If the server refuses it, the view before comes back.
  showView(given) {
    const { view, dropped } = checkedInside(given);
    if (dropped.length > 0) return this.tell(`This view is not shown, because its “${dropped.join('”, “')}” is not valid.`);
    const own = Object.entries(view).filter(([name, value]) => !NOT_SHOWN.includes(name) && !this.isDefault(name, value));
    this.trial = { before: this.live.view, input: this.live.input };
    this.player.stop();
    this.replaceView({ ...Object.fromEntries(own), size: this.live.size, camera: fromWire(view.camera) });
  }

  /// Whether a member has the value that the server uses without it.
  isDefault(name, value) {
    const defaults = this.defaults(), text = JSON.stringify(value), { turned_lights: turned } = this.live.scene;
    return !['mode', 'spp'].includes(name) && (text === JSON.stringify(defaults[name]) || (name === 'lights' && text === JSON.stringify(turned)));
  }

  /// The server has refused a message.
  refused() {
    const { trial } = this;
    this.trial = null;
    if (trial?.before) this.replaceView(trial.before);
  }

  frameDrawn({ input }) {
    if (this.trial && input > this.trial.input) this.trial = null;
  }

  /// The server has made a selection.
  selectionMade() {
    this.live.formChanged();
    this.section.draw();
  }

  /// The server makes no such selection; `members` belong to the last selection that it made.
  selectionRefused(sentence, members) {
    this.live.change(members);
    this.history.forgetSame();
    this.tell(sentence);
  }

  /// Another scene, with its own parts and kept views. `id`: of the scene.
  sceneChanged(id) {
    this.player.stop();
    this.history.reset();
    this.measure.restore([]);
    this.kept.open(id);
    this.parts.reset();
  }

  viewChanged() {
    const { section } = this.live.view;
    this.drawing.place();
    this.gizmo.place();
    if (section !== this.sectionShown) {
      this.sectionShown = section;
      this.section.show();
    }
    this.parts.viewChanged();
    this.selections.ask();
  }

  // --- Clicks

  /// A click at a pixel of the view.
  async click(x, y, event) {
    this.setByKeys(false);
    if (this.measure.isOn) return this.measure.click(x, y);
    return this.showHit(await this.navigation.lastPick, event.ctrlKey || event.metaKey || event.shiftKey);
  }

  async showHit(hit, isMore) {
    if (!isMore) this.card.show(hit);
    const part = await this.parts.choose(hit, isMore);
    if (part && (isMore || this.card.hit === hit)) this.card.show(hit, part);
  }

  hover(x, y) {
    if (!this.measure.isOn) return;
    this.setByKeys(false);
    this.measure.hover(x, y);
  }

  async menu(place) { this.parts.menuAt(place, await this.navigation.lastPick); }

  /// The Enter key: a click at the middle of the picture.
  async clickMiddle() {
    this.setByKeys(true);
    const [x, y] = this.live.size.map((length) => length / 2);
    if (this.measure.isOn) return this.measure.click(x, y);
    return this.showHit(await this.navigation.ask(x, y, () => {}), false);
  }

  async menuMiddle() {
    this.setByKeys(true);
    const box = $('stage').getBoundingClientRect(), [x, y] = this.live.size.map((length) => length / 2);
    this.parts.menuAt({ x: box.left + box.width / 2, y: box.top + box.height / 2 }, await this.navigation.ask(x, y, () => {}));
  }

  /// The crosshair shows the middle of the picture to a person who works with keys.
  setByKeys(isByKeys) {
    this.isByKeys = isByKeys;
    this.onCrosshair();
  }

  /// The facts of a part that was chosen in the tree.
  async showRow(parts) {
    if (parts.length !== 1) return this.card.close();
    const [part] = parts;
    this.card.showPart(part);
    const known = await this.parts.source.part(part.id);  // with its attributes
    if (known && this.card.part === part) this.card.showPart(known.part);
  }

  measureChanged() {
    $('stage').classList.toggle('measuring', this.measure.isOn);
    if (!this.measure.isOn) this.setByKeys(false);
    this.onDrawer('measure');
  }

  playerChanged() {
    $('path-play').textContent = this.player.isOn ? 'Stop' : 'Play';
    document.body.classList.toggle('playing', this.player.isOn);
  }

  /// Ends the innermost thing. Returns whether there was one.
  escape() {
    if (this.player.isOn) this.player.stop();
    else if (this.measure.isOn && this.measure.dropBegun()) return true;
    else if (this.card.isOpen || this.parts.chosen.size > 0) {
      this.card.close();
      this.parts.chosen.clear();
    } else if (this.measure.isOn) this.measure.setOn(false);
    else return false;
    return true;
  }
}
