// Navigation: turns gestures into moves of the camera. Each gesture asks for the point under the cursor, and uses a
// guess until the answer arrives.

import * as cameras from './camera.js';
import { distance } from './vectors.js';

const RADIANS_PER_PIXEL = Math.PI / 600;  // a CSS pixel of a drag: 0.3 degrees
const LOOK_PER_PIXEL = Math.PI / 1200;  // half of it: looking around is steadier than orbiting
const WHEEL_PER_PIXEL = 0.0015;  // of the logarithm of the distance; a notch of 100 pixels: 14 %
const WHEEL_REST_MS = 200;
const GLIDE_MS = 280;
/// Nearest and farthest distance from the point that a dolly goes to, in sizes of the scene.
const NEAREST = 1e-7, FARTHEST = 100;

export class Navigation {
  /// `onPivot(point or null)` runs when a pivot is to be shown or not. `box()`: of all that is shown, [lower, upper].
  constructor(live, onPivot, box) {
    this.live = live;
    this.box = box;
    this.onPivot = onPivot;
    this.pivot = null;  // the point of the last gesture
    this.drag = null;
    this.wheel = null;
    this.gliding = 0;
    this.lastPick = Promise.resolve(null);
  }

  get upAxis() { return this.live.upAxis; }

  /// Forgets the earlier scene.
  reset() {
    this.stopGlide();
    this.pivot = this.drag = this.wheel = null;
  }

  move(camera) {
    const { lower, upper } = this.live.scene;
    this.live.moveTo(cameras.aheadOfBox(camera, lower, upper));
  }

  /// Puts a camera in place without motion.
  put(camera) {
    const { lower, upper, size } = this.live.scene;
    this.live.change({ camera: cameras.rounded(cameras.aheadOfBox(camera, lower, upper), size) });
  }

  /// The best known depth of the scene.
  knownDepth() {
    const { camera } = this.live;
    const depth = this.pivot ? cameras.depthOf(camera, this.pivot) : 0;
    return depth > 0 ? depth : cameras.viewDistance(camera);
  }

  guess(x, y) {
    return cameras.pointAt(this.live.camera, this.live.size, x, y, this.knownDepth());
  }

  /// Asks for the point at a pixel; `use(point)` runs if the ray hits something. Returns the promise of the hit.
  ask(x, y, use) {
    this.lastPick = this.live.pick(x, y);
    this.lastPick.then((hit) => {
      if (hit && this.live.view) {
        this.pivot = hit.position;
        use(hit.position);
      }
    });
    return this.lastPick;
  }

  /// Begins a drag at a pixel: 'orbit', 'pan', 'pinch' or 'look'.
  begin(kind, x, y) {
    this.stopGlide();
    const { camera } = this.live;
    const drag = this.drag = { kind, x, y, factor: 1, start: camera, point: null };
    if (kind === 'look') return;
    const isKnown = this.pivot && cameras.depthOf(camera, this.pivot) > 0;
    drag.point = kind === 'orbit' ? (isKnown ? this.pivot : camera.at) : this.guess(x, y);
    this.ask(x, y, (point) => {
      if (this.drag !== drag) return;
      drag.point = point;
      if (drag.hasMoved) this.follow(drag);
    });
  }

  /// Continues a drag: its pixel, and its movement since the last call in CSS pixels. `factor`: the change of distance
  /// since the beginning of a pinch.
  dragTo(x, y, dx, dy, factor = 1) {
    const { drag } = this;
    if (!drag) return;
    if (!drag.hasMoved) {
      drag.hasMoved = true;
      this.live.hold('drag');
    }
    Object.assign(drag, { x, y, factor });
    if (drag.kind === 'orbit') {
      this.move(cameras.orbit(this.live.camera, drag.point, dx * RADIANS_PER_PIXEL, -dy * RADIANS_PER_PIXEL, this.upAxis));
    } else if (drag.kind === 'look') {
      this.lookBy(dx, dy);
    }
    this.follow(drag);
  }

  lookBy(dx, dy) {
    const turn = LOOK_PER_PIXEL * Math.min(1, this.live.camera.fov / 45);
    this.move(cameras.look(this.live.camera, dx * turn, -dy * turn, this.upAxis));
  }

  /// Moves the camera of a pan or pinch until its point is under the cursor; shows the pivot of an orbit.
  follow(drag) {
    if (drag.kind === 'orbit') return this.onPivot(drag.point);
    if (drag.kind === 'look') return;
    const { size } = this.live;
    const factor = this.limited(drag.start, drag.point, drag.factor);
    const near = factor === 1 ? drag.start : cameras.dolly(drag.start, size, drag.point, factor);
    this.move(cameras.pan(near, size, drag.point, drag.x, drag.y));
  }

  end() {
    this.drag = null;
    this.onPivot(null);
    this.live.release('drag');
  }

  /// Keeps a dolly's factor within the nearest and the farthest distance.
  limited(camera, point, factor) {
    const away = cameras.isOrthographic(camera) ? camera.ortho : distance(camera.eye, point);
    const { size } = this.live.scene;
    return Math.min(Math.max(factor, NEAREST * size / away), Math.max(1, FARTHEST * size / away));
  }

  /// Dollies about the point at a pixel, by a wheel's turn in CSS pixels; away from the user is negative.
  turnWheel(x, y, way) {
    this.stopGlide();
    const now = performance.now();
    const isSame = this.wheel && now - this.wheel.at < 300 && Math.hypot(x - this.wheel.x, y - this.wheel.y) < 8;
    if (!isSame) {
      const wheel = this.wheel = { x, y, point: this.guess(x, y) };
      this.ask(x, y, (point) => { wheel.point = point; });
    }
    this.wheel.at = now;
    this.live.hold('wheel', WHEEL_REST_MS);
    this.dollyAbout(this.wheel.point, Math.exp(way * WHEEL_PER_PIXEL));
  }

  dollyAbout(point, factor) {
    const { camera, size } = this.live;
    if (!(cameras.depthOf(camera, point) > 0)) return;
    this.move(cameras.dolly(camera, size, point, this.limited(camera, point, factor)));
  }

  /// A key's step: angles in radians.
  nudge(yaw, pitch) {
    this.stopGlide();
    this.live.hold('key', WHEEL_REST_MS);
    const isKnown = this.pivot && cameras.depthOf(this.live.camera, this.pivot) > 0;
    this.move(cameras.orbit(this.live.camera, isKnown ? this.pivot : this.live.camera.at, yaw, pitch, this.upAxis));
  }

  /// A key's step toward the middle of the picture, or away from it.
  nudgeNearer(factor) {
    this.stopGlide();
    this.live.hold('key', WHEEL_REST_MS);
    const { size } = this.live;
    this.dollyAbout(this.guess(size[0] / 2, size[1] / 2), factor);
  }

  /// Moves to another camera in a short time.
  glideTo(target) {
    this.stopGlide();
    const { lower, upper } = this.live.scene;
    const to = cameras.aheadOfBox(target, lower, upper);
    const from = this.live.camera, began = performance.now();
    if (matchMedia('(prefers-reduced-motion: reduce)').matches) return this.live.change({ camera: to });
    this.live.hold('glide');
    const step = (now) => {
      const t = Math.min(1, Math.max(0, now - began) / GLIDE_MS);
      this.live.change({ camera: cameras.between(from, to, t * t * (3 - 2 * t), this.upAxis) });
      this.gliding = t < 1 ? requestAnimationFrame(step) : 0;
      if (t === 1) this.live.release('glide');
      this.live.flushInFrame();
    };
    this.gliding = requestAnimationFrame(step);
  }

  stopGlide() {
    cancelAnimationFrame(this.gliding);
    this.gliding = 0;
    this.live.release('glide');
  }

  /// Shows a camera of the scene, in the projection that is in use.
  show(camera) {
    this.pivot = null;
    const isFlat = cameras.isOrthographic(this.live.camera);
    this.glideTo(isFlat ? cameras.toOrthographic(camera, cameras.viewDistance(camera)) : camera);
  }

  frameAll() {
    const { camera, size } = this.live;
    this.pivot = null;
    this.glideTo(cameras.frameBox(camera, size, ...this.box()));
  }

  toggleProjection() {
    this.stopGlide();
    const { camera } = this.live, depth = this.knownDepth();
    this.put(cameras.isOrthographic(camera) ? cameras.toPerspective(camera, depth) : cameras.toOrthographic(camera, depth));
  }

  /// Centres the point at a pixel.
  async centre(x, y) {
    const hit = await this.ask(x, y, () => {});
    if (hit && this.live.view) this.glideTo(cameras.centred(this.live.camera, this.live.size, hit.position));
  }
}
