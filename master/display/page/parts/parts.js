// Parts: the panel with tree and search, the chosen parts, and all that can be done with them.

import { allShown, colourOf, coloured, dimmed, hidden, isDimmed, isHidden, isolated, partsOf, undimmed, unhidden } from './shown_parts.js';
import { Chosen } from './chosen.js';
import { FoundModel, TreeModel } from './tree_model.js';
import { copyText, shown } from '../formats.js';
import { frameBox } from '../camera.js';
import { PartList } from './part_list.js';
import { PartMenu } from './part_menu.js';
import { PartSource } from './part_source.js';

const $ = (id) => document.getElementById(id);
const SEARCH_MS = 120;
const NOTHING = 'No part is chosen: click one first.';

export class Parts {
  /// `app` has live, navigation, drawing, history, tell(SENTENCE), section (with atFace(HIT)); and onRow(PARTS), which
  /// runs when parts are chosen in the tree, onHidden() when the chosen ones are hidden, and onClose() of the panel's
  /// button.
  constructor(app) {
    Object.assign(this, app);
    this.source = new PartSource((list) => this.loaded(list), (sentence) => this.tell(sentence));
    this.chosen = new Chosen(this.drawing, () => this.chosenChanged(), this.tell);
    this.list = new PartList($('tree'), {
      parts: () => this.live.view ?? {}, isChosen: (part) => this.chosen.has(part),
      on: {
        choose: (part, number, event) => this.chooseRow(part, number, event), eye: (part) => this.toggleHidden(part),
        fly: (part) => this.flyTo(part.box), menu: (part, place) => this.openMenu(place, part, null),
      },
    });
    this.menu = new PartMenu({
      hide: () => this.hide(), only: () => this.isolate(), fly: () => this.flyTo(this.chosen.box), copy: () => this.copyName(),
      colour: (colour) => this.colour(colour), section: (hit) => this.section.atFace(hit),
    });
    this.choosing = Promise.resolve();
    $('parts-search').addEventListener('input', () => this.searchSoon());
    $('parts-search').addEventListener('keydown', (event) => this.searchKey(event));
    $('parts-close').addEventListener('click', () => this.onClose());
    $('parts-all').addEventListener('click', () => this.showAll());
    $('parts-hide').addEventListener('click', () => this.hide());
    $('parts-only').addEventListener('click', () => this.isolate());
    $('parts-dim').addEventListener('click', () => this.toggleDim());
  }

  get isOpen() { return !$('parts').hidden; }

  setOpen(isOpen) {
    $('parts').hidden = !isOpen;
    if (isOpen && !this.list.model) this.search();
    if (isOpen) this.reveal();
    this.list.render();
  }

  /// Another scene has other parts.
  reset() {
    this.source.reset();
    this.chosen.clear();
    this.tree = this.list.model = null;
    $('parts-search').value = '';
    if (this.isOpen) this.search();
  }

  // --- Search

  searchSoon() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.search(), SEARCH_MS);
  }

  search() {
    const text = $('parts-search').value.trim();
    this.tree ??= new TreeModel((id) => this.source.childrenOf(id));
    this.found = text ? this.source.find(text) : null;
    this.chosen.anchor = null;
    this.list.setModel(this.found ? new FoundModel(this.found) : this.tree);
    this.showCount();
  }

  /// The search field's keys: down goes to the list.
  searchKey(event) {
    if (event.key === 'ArrowDown') this.list.setFocus(0);
    else if (event.key === 'Escape' && event.target.value) {
      event.target.value = '';
      this.search();
    } else return;
    event.preventDefault();
    event.stopPropagation();
  }

  loaded(list) {
    if (list === this.found || !this.found) this.list.refresh();
    this.chosen.loaded();
    this.showCount();
  }

  showCount() {
    const { view } = this.live, total = this.found ? this.found.total : null;
    const text = total === null ? '' : `${total.toLocaleString('en')} ${total === 1 ? 'part' : 'parts'}`;
    if ($('parts-count').textContent !== text) $('parts-count').textContent = text;
    $('parts-all').disabled = !view?.hide && !view?.only;
  }

  // --- Chosen parts

  chosenChanged() {
    this.list.refresh();
    $('parts-hide').disabled = $('parts-only').disabled = this.chosen.size === 0;
    this.showDim();
    if (this.isDimmed && this.chosen.size > 0) this.live.change(dimmed(this.parts, this.chosen.paths));
  }

  chooseRow(part, number, event) {
    this.chosen.clickRow(part, number, event, this.list.model);
    this.onRow([...this.chosen.parts.values()]);
  }

  /// Chooses the part of a HIT. Returns its facts, or null. Clicks count in their order, however long their parts take to
  /// come.
  choose(hit, isMore = false) {
    const part = this.choosing.then(() => this.chooseNow(hit, isMore));
    this.choosing = part.catch(() => null);
    return part;
  }

  async chooseNow(hit, isMore) {
    if (!hit) {
      if (!isMore) this.chosen.clear();
      return null;
    }
    const known = hit.part_id === undefined ? null : await this.source.part(hit.part_id);
    if (!known) return null;
    if (isMore) this.chosen.toggle(known.part);
    else this.chosen.set([known.part]);
    this.reveal();
    return known.part;
  }

  /// Opens the tree down to the part that was chosen last, and scrolls there.
  async reveal() {
    const part = [...this.chosen.parts.values()].at(-1);
    if (!part || !this.isOpen || this.found) return;
    const known = await this.source.part(part.id);
    if (!known || !this.chosen.has(part) || this.found) return;
    this.list.showRow(this.tree.reveal(known.ancestors, known.places));
    this.list.refresh();
  }

  // --- Changes of the view

  change(parts, sentence) {
    this.history.note();
    this.live.change({ hide: undefined, only: undefined, ...parts });
    if (sentence) this.tell(sentence);
  }

  get parts() { return partsOf(this.live.view ?? {}); }

  withChosen(use) {
    const { paths } = this.chosen;
    if (paths.length === 0) return this.tell(NOTHING);
    use(paths, paths.length === 1 ? shown(paths[0].split('/').at(-1)) : `${paths.length.toLocaleString('en')} parts`);
  }

  hide() {
    this.withChosen((paths, name) => {
      this.change(hidden(this.parts, paths), `${name}: hidden. Shift+H shows all, Ctrl+Z takes it back.`);
      this.chosen.clear();
      this.onHidden();
    });
  }

  isolate() { this.withChosen((paths, name) => this.change(isolated(this.parts, paths), `Only ${name}. Shift+H shows all.`)); }

  showAll() {
    if (this.live.view) this.change(allShown(this.parts), 'All parts are shown.');
  }

  colour(colour) { this.withChosen((paths) => this.change({ colors: undefined, ...coloured(this.parts, paths, colour) })); }

  get isDimmed() { return isDimmed(this.parts); }

  /// Dims all but the chosen parts, until it is used again; other chosen parts then take their place.
  toggleDim() {
    if (this.isDimmed) this.change({ colors: undefined, ...undimmed(this.parts) });
    else this.withChosen((paths) => this.change(dimmed(this.parts, paths)));
  }

  showDim() {
    $('parts-dim').setAttribute('aria-pressed', String(this.isDimmed));
    $('parts-dim').disabled = this.chosen.size === 0 && !this.isDimmed;
  }

  toggleHidden({ path }) {
    this.change(isHidden(this.parts, path) ? unhidden(this.parts, [path]) : hidden(this.parts, [path]));
  }

  flyTo(box) {
    if (!box) return this.tell('This part has no triangles.');
    const { live, navigation } = this;
    navigation.pivot = null;
    navigation.glideTo(frameBox(live.camera, live.size, ...box));
  }

  async copyName() {
    const text = [...this.chosen.parts.values()].map(({ path }) => path).join('\n');
    this.tell(await copyText(text) ? 'The name is copied.' : 'The browser did not allow copying.');
  }

  // --- Menu

  /// Opens the menu of a part; if it is one of the chosen ones, of all these.
  openMenu(place, part, hit) {
    if (!this.chosen.has(part)) this.chosen.set([part]);
    const title = this.chosen.size > 1 ? `${this.chosen.size.toLocaleString('en')} parts` : shown(part.name) || '(no name)';
    this.menu.open(place, title, hit, colourOf(this.parts, part.path));
  }

  /// Opens the menu at a place in the picture.
  async menuAt(place, hit) {
    const known = hit && hit.part_id !== undefined && await this.source.part(hit.part_id);
    if (known) this.openMenu(place, known.part, hit);
    else if (!hit) this.tell('There is no part.');
  }

  /// The view has changed.
  viewChanged() {
    const { hide, only, colors } = this.live.view ?? {};
    if (this.seen && this.seen[0] === hide && this.seen[1] === only && this.seen[2] === colors) return;
    this.seen = [hide, only, colors];
    this.list.refresh();
    this.showCount();
    this.showDim();
  }
}
