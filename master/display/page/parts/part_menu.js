// The menu of a part or of the chosen parts: by right click, long press or the Menu key.

import { element } from '../formats.js';
import { hexToRadiance, radianceToHex } from '../colours.js';

const $ = (id) => document.getElementById(id);
const COLOURS = [['red', '#d9483b'], ['orange', '#e8963a'], ['yellow', '#e5cf49'], ['green', '#58a65c'], ['blue', '#3f7fd0'], ['violet', '#9a62c7']];
/// Least distance of the menu from the window's edges, CSS pixels.
const MARGIN = 6;

export class PartMenu {
  /// `on`: hide(), only(), colour(COLOUR or null), section(HIT), fly(), copy().
  constructor(on) {
    this.on = on;
    this.menu = $('part-menu');
    this.before = null;  // the element that had the focus
    this.menu.addEventListener('keydown', (event) => this.key(event));
    this.menu.addEventListener('focusout', ({ relatedTarget }) => this.menu.contains(relatedTarget) || this.close());
    addEventListener('pointerdown', ({ target }) => this.menu.contains(target) || this.close());
    addEventListener('resize', () => this.close());
  }

  get isOpen() { return !this.menu.hidden; }

  /// Opens at a place in the window. `title`: of the parts; `hit`: the HIT under the cursor, or null; `colour`: of the
  /// parts, or null.
  open({ x, y }, title, hit, colour) {
    this.before = document.activeElement;
    const own = element('input', { type: 'color', value: colour ? radianceToHex(colour, 0) : '#58a65c', tabIndex: -1 });
    own.setAttribute('aria-label', 'Another colour');
    own.setAttribute('role', 'menuitem');
    own.addEventListener('change', () => this.use(() => this.on.colour(hexToRadiance(own.value, 0))));
    const swatches = COLOURS.map(([name, hex]) => {
      const made = this.item('', () => this.on.colour(hexToRadiance(hex, 0)));
      made.className = 'colour';
      made.title = name;
      made.setAttribute('aria-label', `Colour: ${name}`);
      made.style.background = hex;
      return made;
    });
    this.menu.replaceChildren(element('p', { className: 'menu-title' }, title),
      this.item('Hide', () => this.on.hide(), 'H'), this.item('Only this', () => this.on.only(), 'I'), this.item('Fly to', () => this.on.fly()),
      element('div', { className: 'colours' }, ...swatches, own), ...(colour ? [this.item('Own colour', () => this.on.colour(null))] : []),
      ...(hit ? [this.item('Section at this face', () => this.on.section(hit))] : []), this.item('Copy name', () => this.on.copy()));
    this.menu.setAttribute('aria-label', title);
    this.menu.hidden = false;
    const { offsetWidth: width, offsetHeight: height } = this.menu;
    this.menu.style.left = `${Math.max(MARGIN, Math.min(x, innerWidth - width - MARGIN))}px`;
    this.menu.style.top = `${Math.max(MARGIN, Math.min(y, innerHeight - height - MARGIN))}px`;
    this.items[0].focus({ preventScroll: true });
  }

  get items() { return [...this.menu.querySelectorAll('[role=menuitem]')]; }

  item(text, use, key = '') {
    const made = element('button', { type: 'button', tabIndex: -1 }, element('span', {}, text));
    if (key) made.append(element('kbd', {}, key));
    made.setAttribute('role', 'menuitem');
    made.addEventListener('click', () => this.use(use));
    return made;
  }

  use(action) {
    this.close();
    action();
  }

  close() {
    if (!this.isOpen) return;
    this.menu.hidden = true;
    this.before?.focus?.({ preventScroll: true });
  }

  key(event) {
    const { items } = this, at = items.indexOf(document.activeElement), { key } = event;
    const next = { ArrowDown: at + 1, ArrowRight: at + 1, ArrowUp: at - 1, ArrowLeft: at - 1, Home: 0, End: items.length - 1 }[key];
    if (next !== undefined) items[(next + items.length) % items.length].focus();
    else if (key === 'Escape' || key === 'Tab') this.close();
    else if (key !== 'Enter' && key !== ' ') return void event.stopPropagation();
    if (key !== 'Enter' && key !== ' ') event.preventDefault();
    event.stopPropagation();
  }
}
