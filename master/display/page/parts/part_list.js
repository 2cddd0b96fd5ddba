// The list of parts: a tree of any length, of which only the rows in sight exist. Keys as in an ARIA tree.

import { compact, element, shown } from '../formats.js';
import { colourOf, isHidden } from './shown_parts.js';
import { radianceToHex } from '../colours.js';

/// Rows beyond the window that exist too, so that a fast scroll shows few gaps.
const SPARE = 6;
/// Browsers draw no taller elements. A longer list is scrolled in larger steps.
const TALLEST = 10e6;  // CSS pixels

export class PartList {
  /// Shows a model in `element`. `app` has parts(): the view's lists of parts; isChosen(part); and on: choose(part, row,
  /// event), eye(part), fly(part), menu(part, place).
  constructor(element_, app) {
    Object.assign(this, app);
    this.element = element_;
    this.model = null;
    this.rows = new Map();  // elements by row number
    this.focus = 0;  // the row that the Tab key reaches
    this.height = 0;
    this.inner = element('div', { className: 'rows' });
    this.inner.setAttribute('role', 'none');
    this.element.append(this.inner);
    this.element.addEventListener('scroll', () => this.render());
    this.element.addEventListener('keydown', (event) => this.key(event));
    this.element.addEventListener('click', (event) => this.click(event));
    this.element.addEventListener('dblclick', (event) => this.withRow(event, ({ part }) => part && this.on.fly(part)));
    this.element.addEventListener('contextmenu', (event) => {
      event.preventDefault();
      this.withRow(event, ({ part }) => part && this.on.menu(part, { x: event.clientX, y: event.clientY }));
    });
    new ResizeObserver(() => this.render()).observe(this.element);
  }

  setModel(model) {
    this.model = model;
    this.focus = 0;
    this.element.scrollTop = 0;
    this.refresh();
  }

  refresh() {
    for (const made of this.rows.values()) made.dataset.is = '';
    this.render();
  }

  /// Height of a row in CSS pixels, by the style sheet.
  measure() {
    const probe = element('div', { className: 'row' }, ' ');
    this.inner.append(probe);
    this.height = probe.offsetHeight;
    probe.remove();
  }

  /// {top, ratio}: the part of the list in sight begins at `top`, and a pixel of the scroll bar is `ratio` pixels of it.
  get window() {
    const whole = this.model.rows * this.height, { clientHeight, scrollTop } = this.element, tall = Math.min(whole, TALLEST);
    const ratio = tall > clientHeight ? (whole - clientHeight) / (tall - clientHeight) : 1;
    return { top: scrollTop * ratio, ratio, tall };
  }

  render() {
    if (!this.model || this.element.clientHeight === 0) return;
    if (!this.height) this.measure();
    const count = this.model.rows;
    this.focus = Math.max(0, Math.min(this.focus, count - 1));
    const { top, tall } = this.window;
    this.inner.style.height = `${tall}px`;
    const first = Math.max(0, Math.floor(top / this.height) - SPARE);
    const last = Math.min(count - 1, Math.ceil((top + this.element.clientHeight) / this.height) + SPARE);
    const wanted = new Set([this.focus]);  // the focused row stays, or the keyboard would lose its place
    for (let number = first; number <= last; ++number) wanted.add(number);
    for (const [number, made] of this.rows) if (!wanted.has(number)) this.drop(number, made);
    for (const number of wanted) this.fill(number, top);
  }

  drop(number, made) {
    made.remove();
    this.rows.delete(number);
  }

  fill(number, top) {
    const row = this.model.row(number);
    if (!row) return;
    if (!this.rows.has(number)) {
      const made = element('div', { className: 'row' });
      made.dataset.number = String(number);
      made.setAttribute('role', 'treeitem');
      this.rows.set(number, made);
      this.inner.append(made);
    }
    const made = this.rows.get(number), { part } = row;
    made.style.top = `${number * this.height - top + this.element.scrollTop}px`;
    made.tabIndex = number === this.focus ? 0 : -1;
    const is = part ? this.stateOf(row) : 'waiting';
    if (made.dataset.is === JSON.stringify(is)) return;
    made.dataset.is = JSON.stringify(is);
    this.write(made, row, is);
  }

  stateOf({ part, level, place, of, isOpen }) {
    const parts = this.parts();
    return { id: part.id, level, place, of, isOpen, chosen: this.isChosen(part), hidden: isHidden(parts, part.path), colour: colourOf(parts, part.path) };
  }

  write(made, { part, level, place, of, isOpen }, is) {
    made.setAttribute('aria-level', String(level));
    made.setAttribute('aria-posinset', String(place + 1));
    made.setAttribute('aria-setsize', String(of));
    made.style.paddingLeft = `${(level - 1) * 14 + 2}px`;
    made.classList.toggle('hidden-part', Boolean(is.hidden));
    made.removeAttribute('aria-expanded');
    if (!part) return made.replaceChildren(element('span', { className: 'waits' }, '…'));
    made.setAttribute('aria-selected', String(is.chosen));
    const name = shown(part.name) || '(no name)', hasMore = part.children > 0 && this.model.isTree;
    made.setAttribute('aria-label', `${name}${is.hidden ? ', hidden' : ''}${part.triangles === null ? '' : `, ${part.triangles.toLocaleString('en')} triangles`}`);
    made.title = shown(part.path);
    const twist = element('span', { className: 'twist' }, hasMore ? (isOpen ? '▾' : '▸') : '');
    if (hasMore) made.setAttribute('aria-expanded', String(isOpen));
    const eye = element('button', { type: 'button', className: 'eye', tabIndex: -1, title: is.hidden ? 'Show' : 'Hide' });
    eye.setAttribute('aria-label', `${is.hidden ? 'Show' : 'Hide'} ${name}`);
    const swatch = element('span', { className: 'swatch' });
    swatch.hidden = !is.colour;
    if (is.colour) swatch.style.background = radianceToHex(is.colour, 0);
    const above = this.model.isTree ? '' : shown(part.path).slice(0, -name.length).replace(/\/$/, '');
    made.replaceChildren(twist, eye, swatch, element('span', { className: 'name' }, name, element('span', { className: 'above' }, above)),
      element('span', { className: 'count' }, part.triangles === null ? '' : compact(part.triangles)));
  }

  /// Calls `use(row, number, target)` for the row of an event.
  withRow({ target }, use) {
    const made = target.closest('.row');
    const row = made && this.model.row(Number(made.dataset.number));
    if (row) use(row, Number(made.dataset.number), target);
  }

  click(event) {
    this.withRow(event, (row, number, target) => {
      if (!row.part) return;
      this.setFocus(number);
      if (target.closest('.eye')) this.on.eye(row.part);
      else if (target.closest('.twist') && row.part.children > 0) this.toggle(row);
      else this.on.choose(row.part, number, event);
    });
  }

  toggle(row) {
    if (row.isOpen) this.model.close(row);
    else this.model.open(row);
    this.refresh();
  }

  /// Moves the keyboard's place to a row, in sight.
  setFocus(number) {
    this.focus = Math.max(0, Math.min(number, this.model.rows - 1));
    const { top, ratio } = this.window, at = this.focus * this.height, room = this.element.clientHeight - this.height;
    if (at < top || at > top + room) this.element.scrollTop = Math.max(0, at - (at < top ? 0 : room)) / ratio;
    this.render();
    this.rows.get(this.focus)?.focus({ preventScroll: true });
  }

  /// Scrolls a row to the middle, without the keyboard's focus.
  showRow(number) {
    if (number < 0) return;
    if (!this.height) this.measure();
    this.focus = number;
    this.render();
    this.element.scrollTop = Math.max(0, number * this.height - this.element.clientHeight / 2) / this.window.ratio;
    this.render();
  }

  key(event) {
    if (event.altKey || event.metaKey) return;
    const row = this.model.row(this.focus), page = Math.max(1, Math.floor(this.element.clientHeight / this.height) - 1);
    const isOpenable = row?.part?.children > 0 && this.model.isTree;
    const moves = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -Infinity, End: Infinity };
    const uses = {
      ArrowRight: () => (row.isOpen ? this.setFocus(this.focus + 1) : isOpenable && this.toggle(row)),
      ArrowLeft: () => (row.isOpen ? this.toggle(row) : this.setFocus(Math.max(0, this.model.above(row)))),
      Enter: () => this.on.choose(row.part, this.focus, event),
      ' ': () => this.on.choose(row.part, this.focus, { ctrlKey: true }),
      ContextMenu: () => this.menuAtFocus(row.part),
      F10: () => event.shiftKey && this.menuAtFocus(row.part),
    };
    const { key } = event;
    if (moves[key] !== undefined) this.step(moves[key], event.shiftKey);
    else if (uses[key] && row?.part && !(event.ctrlKey && key !== ' ')) uses[key]();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  /// Moves by rows; with Shift the range on the way is chosen.
  step(by, isRange) {
    this.setFocus(this.focus + by);
    const row = this.model.row(this.focus);
    if (isRange && row) this.on.choose(row.part, this.focus, { shiftKey: true });
  }

  menuAtFocus(part) {
    const box = this.rows.get(this.focus).getBoundingClientRect();
    this.on.menu(part, { x: box.left + 60, y: box.bottom });
  }
}
