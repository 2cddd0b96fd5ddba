// Pointers: mouse, pen and touch on the picture become gestures of navigation.

const CLICK_MOST_PIXELS = 4, CLICK_MOST_MS = 600;
const LINE_PIXELS = 16;  // of a wheel that counts lines
const PINCH_WHEEL = 6;  // a trackpad's pinch comes as a wheel of small steps with ctrl

/// A finger that rests for this long opens the menu.
const LONG_PRESS_MS = 550;

/// Listens on `stage`. `on` has drag() when one begins; in pixels of the view click(x, y, event), doubleClick(x, y) and
/// hover(x, y); and menu({x, y}) at a place in the window.
export class Pointers {
  constructor(stage, live, navigation, flight, on) {
    Object.assign(this, { stage, live, navigation, flight, on });
    this.pointers = new Map();
    this.press = null;  // where and when a lone pointer went down, while it may become a click
    const listen = (name, handle) => stage.addEventListener(name, (event) => this.live.view && handle(event));
    listen('pointerdown', (event) => this.down(event));
    listen('pointermove', (event) => this.move(event));
    listen('pointerup', (event) => this.up(event));
    listen('pointercancel', (event) => this.up(event));
    listen('lostpointercapture', (event) => this.pointers.has(event.pointerId) && this.up(event));
    listen('dblclick', (event) => this.flight.isOn || this.on.doubleClick(...this.pixelOf(event)));
    stage.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    stage.addEventListener('contextmenu', (event) => event.preventDefault());
    // Otherwise the browser makes a mouse's click of the finger that leaves, which closes the menu.
    stage.addEventListener('touchend', (event) => this.isMenuTouch && event.preventDefault(), { passive: false });
    // Otherwise a middle click would scroll, or paste and follow a link.
    stage.addEventListener('auxclick', (event) => event.preventDefault());
    addEventListener('blur', () => this.letGo());
    document.addEventListener('visibilitychange', () => document.hidden && this.letGo());
  }

  get isLocked() { return document.pointerLockElement === this.stage; }

  /// The position in pixels of the view.
  pixelOf({ clientX, clientY }) {
    const box = this.stage.getBoundingClientRect(), [width, height] = this.live.size;
    return [(clientX - box.left) / box.width * width, (clientY - box.top) / box.height * height];
  }

  down(event) {
    if (this.isLocked) return document.exitPointerLock();
    if (event.pointerType === 'mouse') event.preventDefault();
    this.stage.focus({ preventScroll: true });
    this.stage.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    this.press = this.pointers.size === 1 && event.button !== 1
      ? { x: event.clientX, y: event.clientY, at: performance.now(), button: event.button } : null;
    this.beginDrag(event.button, event.shiftKey);
    clearTimeout(this.resting);
    this.isMenuTouch = false;
    if (this.press && event.pointerType === 'touch') this.resting = setTimeout(() => this.longPress(), LONG_PRESS_MS);
  }

  /// Opens the menu at a resting finger, which then is no drag.
  longPress() {
    const { press } = this;
    if (!press) return;
    this.letGo();
    this.isMenuTouch = true;
    this.on.menu({ x: press.x, y: press.y });
  }

  /// Begins the gesture of the present pointers.
  beginDrag(button, isShift) {
    if (this.pointers.size >= 2) return this.beginPinch();
    const [{ x, y }] = this.pointers.values();
    const kind = button !== 0 || isShift ? 'pan' : this.flight.isOn ? 'look' : 'orbit';
    this.navigation.begin(kind, ...this.pixelOf({ clientX: x, clientY: y }));
  }

  /// Centre and spread of the first two pointers, CSS pixels.
  pair() {
    const [a, b] = this.pointers.values();
    return { clientX: (a.x + b.x) / 2, clientY: (a.y + b.y) / 2, spread: Math.max(1, Math.hypot(a.x - b.x, a.y - b.y)) };
  }

  beginPinch() {
    this.navigation.end();
    const pair = this.pair();
    this.spread = pair.spread;
    this.navigation.begin('pinch', ...this.pixelOf(pair));
  }

  move(event) {
    if (this.isLocked) return this.lookLocked(event);
    const pointer = this.pointers.get(event.pointerId);
    if (!pointer) return this.pointers.size || this.on.hover(...this.pixelOf(event));
    const dx = event.clientX - pointer.x, dy = event.clientY - pointer.y;
    if (this.press && Math.hypot(event.clientX - this.press.x, event.clientY - this.press.y) < CLICK_MOST_PIXELS) return;
    this.press = null;
    this.on.drag();
    Object.assign(pointer, { x: event.clientX, y: event.clientY });
    if (this.pointers.size >= 2) {
      const pair = this.pair();
      return this.navigation.dragTo(...this.pixelOf(pair), 0, 0, this.spread / pair.spread);
    }
    this.navigation.dragTo(...this.pixelOf(event), dx, dy);
  }

  lookLocked(event) {
    this.live.hold('look', 150);
    this.navigation.lookBy(event.movementX, event.movementY);
  }

  up(event) {
    if (!this.pointers.delete(event.pointerId)) return;
    this.navigation.end();
    const press = this.press;
    this.press = null;
    if (this.pointers.size) return this.beginDrag(0, false);
    if (!press || event.type !== 'pointerup') return;
    if (press.button === 2) this.on.menu({ x: event.clientX, y: event.clientY });
    else if (performance.now() - press.at < CLICK_MOST_MS) this.click(event);
  }

  click(event) {
    if (!this.flight.isOn) return this.on.click(...this.pixelOf(event), event);
    // Browsers refuse it just after Escape; a drag still looks around.
    if (event.pointerType === 'mouse') this.stage.requestPointerLock?.()?.catch?.(() => {});
  }

  letGo() {
    if (!this.pointers.size) return;
    this.pointers.clear();
    this.press = null;
    this.navigation.end();
  }

  wheel(event) {
    event.preventDefault();
    if (!this.live.view) return;
    const unit = event.deltaMode === 1 ? LINE_PIXELS : event.deltaMode === 2 ? this.stage.clientHeight : 1;
    const way = Math.min(300, Math.max(-300, event.deltaY * unit * (event.ctrlKey ? PINCH_WHEEL : 1)));
    if (this.flight.isOn) return this.flight.faster(2 ** (-way / 200));
    this.navigation.turnWheel(...this.pixelOf(event), way);
  }
}
