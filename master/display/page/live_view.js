// The view that is shown: all parts of the page change it, and it is sent at most once an animation frame. Picks are
// sent in the same way.

import { rounded } from './camera.js';
import { fromWire } from './view_state.js';

/// A pick without an answer for this long counts as a miss.
const PICK_MS = 3000;

/// Least time between two views in motion. Screens may have 240 animation frames a second; the server takes 300
/// messages.
const LEAST_MS = 6.5;

export class LiveView {
  /// `onChange()` runs after each change of the view, `onRest()` when a view without motion has been sent. `wire`:
  /// message(VIEW), the view in the server's form or null while it cannot be sent; and isWaiting: the server does not
  /// know a part of the view yet.
  constructor(connection, wire, onChange, onRest) {
    this.connection = connection;
    this.wire = wire;
    this.onChange = onChange;
    this.onRest = onRest;
    this.view = null;
    this.scene = null;
    this.modes = [];  // of the server
    this.defaults = {};  // the server's default view
    this.input = 0;  // number of the view sent last
    this.holds = new Map();  // the parts of the page that are moving: name to timer, or 0
    this.hasMoved = false;  // whether the camera has moved since the last rest
    this.sent = '';
    this.sentAt = -Infinity;
    this.wasMoving = false;
    this.changed = null;  // when the oldest unsent change was made
    this.scheduled = 0;
    this.picks = new Map();
    this.pickCount = 0;
  }

  get camera() { return this.view.camera; }
  get size() { return this.view.size; }
  /// "y" or "z": the scene's axis, unless the view has another.
  get upAxis() { return this.view?.up_axis ?? this.scene.up_axis; }
  /// The view's lights. `lights`: the default view's.
  lights(lights) {
    if (this.hasSky) return [];
    if (this.scene?.shines && this.view?.mode === 'path' && !this.view.sky) return [];
    const own = this.upAxis === this.scene?.up_axis ? lights : this.scene?.turned_lights;
    return this.scene?.lamp && this.view?.mode === 'path' ? [...own, this.scene.lamp] : own;
  }
  /// Whether an environment is the view's light.
  get hasSky() { return this.view?.mode === 'path' && this.view.environment !== undefined; }
  /// The view's mode, as the server describes it.
  get mode() { return this.modes.find(({ name }) => name === this.view?.mode); }
  /// The names of the view's lights. Null: the mode has a light of its own.
  get lightNames() {
    if (!this.mode?.uses_lights) return null;
    const own = this.view.lights, all = own ?? this.lights(this.defaults.lights ?? []), isPath = this.view.mode === 'path';
    const names = new Map();
    for (const { type, position } of all) {
      const name = position === 'eye' ? 'lamp at the eye' : type;
      names.set(name, (names.get(name) ?? 0) + 1);
    }
    const list = [...names].map(([name, count]) => (count > 1 ? `${count} ${name}s` : name));
    if (this.hasSky) list.push(this.view.environment.name);
    else if (isPath && (this.view.sky ?? (own ? null : this.defaults.sky))) list.push('sky');
    if (isPath && list.length === 0) list.push('surfaces that shine');
    return list.length > 0 ? list.join(', ') : 'none';
  }
  /// The named views with that axis up.
  get namedViews() { return this.upAxis === this.scene?.up_axis ? this.scene.views : this.scene?.turned_views; }
  get isMoving() { return this.holds.size > 0; }

  /// Moves the camera. Within a hold the camera is rounded when the hold ends.
  moveTo(camera) {
    this.hasMoved = true;
    this.change({ camera });
  }

  /// Replaces members of the view; a member that is undefined is removed.
  change(members) {
    this.view = { ...this.view, ...members };
    for (const name of Object.keys(members)) if (members[name] === undefined) delete this.view[name];
    this.changed ??= performance.now();
    this.schedule();
    this.onChange();
  }

  /// Puts a whole view from outside in place. Returns the number under which it is sent, or null without connection.
  replace(view) {
    this.endHolds();
    this.hasMoved = false;
    this.view = { ...view, camera: fromWire(view.camera) };
    this.changed ??= performance.now();
    this.onChange();
    return this.flush() ? this.input : null;
  }

  /// Marks the view as moving until release(), or for `ms`.
  hold(name, ms = 0) {
    clearTimeout(this.holds.get(name));
    this.holds.set(name, ms ? setTimeout(() => this.release(name), ms) : 0);
  }

  release(name) {
    clearTimeout(this.holds.get(name));
    if (!this.holds.delete(name) || this.isMoving) return;
    if (this.hasMoved) {
      this.hasMoved = false;
      this.change({ camera: rounded(this.camera, this.scene.size) });
    }
    this.schedule();
  }

  endHolds() {
    for (const timer of this.holds.values()) clearTimeout(timer);
    this.holds.clear();
  }

  schedule() {
    this.scheduled ||= requestAnimationFrame(() => {
      this.scheduled = 0;
      if (this.isTooSoon) this.schedule();
      else this.flush();
    });
  }

  get isTooSoon() { return this.isMoving && performance.now() - this.sentAt < LEAST_MS; }

  /// Sends the view of an animation frame in this frame and not in the next. Requires: the caller comes again
  /// in the next frame, or releases its hold. A scheduled flush would send an older view first, and delay this one.
  flushInFrame() {
    cancelAnimationFrame(this.scheduled);
    this.scheduled = 0;
    if (!this.isTooSoon) this.flush();
  }

  /// Sends the view if it, or its motion, has changed. Returns whether the server has the newest view.
  flush() {
    const view = this.connection.isOpen ? this.message() : null;
    if (!view) return false;
    const text = JSON.stringify(view), moving = this.isMoving;
    const isNews = text !== this.sent || (this.wasMoving && !moving);
    const time = this.changed ?? performance.now();
    this.changed = null;
    if (!isNews) return true;
    this.connection.send({ type: 'view', input: ++this.input, time, moving, view });
    this.sent = text;
    this.sentAt = performance.now();
    this.wasMoving = moving;
    if (!moving) this.onRest();
    return true;
  }

  /// Sends the view again, for frames by new settings.
  resend() {
    this.sent = '';
    this.schedule();
  }

  /// The view has another form for the server now.
  formChanged() {
    this.changed ??= performance.now();
    this.schedule();
  }

  /// Whether the server has got everything that the page shows.
  get isSent() { return this.changed === null && !this.wire.isWaiting; }

  /// The view in the server's form, or null.
  message() { return this.view && this.wire.message(this.view); }

  /// Starts again on a new connection: nothing has been sent, and pending picks are lost.
  reconnected() {
    this.sent = '';
    this.wasMoving = false;
    for (const answer of [...this.picks.values()]) answer(null);
    this.flush();
  }

  /// The surface at a pixel: the server's HIT, or null.
  pick(x, y) { return this.pickBy({ x, y }); }

  /// The first surface along a ray.
  pickAlong(origin, direction) { return this.pickBy({ origin, direction }); }

  pickBy(place) {
    if (!this.flush()) return Promise.resolve(null);
    const pick = ++this.pickCount;
    return new Promise((resolve) => {
      const timer = setTimeout(() => answer(null), PICK_MS);
      const answer = (hit) => {
        clearTimeout(timer);
        this.picks.delete(pick);
        resolve(hit);
      };
      this.picks.set(pick, answer);
      this.connection.send({ type: 'pick', pick, ...place });
    });
  }

  picked({ pick, hit }) { this.picks.get(pick)?.(hit); }
}
