// Flight: the camera moves while keys are held, at a speed that follows the distance ahead.

import * as cameras from './camera.js';

/// The keys that move, by their place on the keyboard: steps to the right, up and forward.
const MOVES = {
  KeyW: [0, 0, 1], KeyS: [0, 0, -1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyE: [0, 1, 0], KeyQ: [0, -1, 0],
};
const SHARE_PER_S = 0.5;  // of the distance ahead, flown in a second
const SLOWEST = 1e-4, FASTEST = 1;  // sizes of the scene a second
const SHIFT = 4;
const SMOOTHING_S = 0.4;  // time in which the speed covers two thirds of a change
const LOOK_AHEAD_MS = 250;  // between two looks at the distance ahead
const MOST_STEP_S = 0.1;  // a late animation frame does not leap

export class Flight {
  /// `onChange()` runs when flight begins, ends, or its factor changes.
  constructor(live, navigation, onChange) {
    this.live = live;
    this.navigation = navigation;
    this.onChange = onChange;
    this.isOn = false;
    this.keys = new Set();
    this.isFast = false;
    this.factor = 1;
    this.speed = 0;  // scene units a second, before the factor
    this.target = 0;
    this.lookedAt = -Infinity;
    this.ticking = 0;
  }

  toggle() { this.isOn ? this.stop() : this.start(); }

  start() {
    if (this.isOn || !this.live.view) return;
    this.isOn = true;
    this.navigation.stopGlide();
    if (cameras.isOrthographic(this.live.camera)) this.navigation.toggleProjection();
    this.speed = this.target = this.speedFor(this.navigation.knownDepth());
    this.lookAhead(performance.now());
    this.onChange();
  }

  stop() {
    if (!this.isOn) return;
    this.isOn = false;
    this.letGo();
    this.onChange();
  }

  /// Whether a key moves the camera. Codes are values of KeyboardEvent.code.
  press(code) {
    if (!this.isOn || !MOVES[code]) return false;
    this.keys.add(code);
    if (!this.ticking) {
      this.last = performance.now();
      this.ticking = requestAnimationFrame((now) => this.tick(now));
    }
    return true;
  }

  release(code) {
    if (this.keys.delete(code) && !this.keys.size) this.letGo();
  }

  /// Lets all keys go.
  letGo() {
    this.keys.clear();
    this.isFast = false;
    cancelAnimationFrame(this.ticking);
    this.ticking = 0;
    this.live.release('flight');
  }

  faster(by) {
    this.factor = Math.min(16, Math.max(1 / 16, this.factor * by));
    this.onChange();
  }

  speedFor(distance) {
    const { size } = this.live.scene;
    return Math.min(FASTEST * size, Math.max(SLOWEST * size, SHARE_PER_S * distance));
  }

  tick(now) {
    const seconds = Math.min(MOST_STEP_S, Math.max(0, now - this.last) / 1000);
    this.last = now;
    this.lookAhead(now);
    this.speed += (this.target - this.speed) * (1 - Math.exp(-seconds / SMOOTHING_S));
    const way = [0, 0, 0];
    for (const key of this.keys) MOVES[key].forEach((x, i) => { way[i] += x; });
    const length = Math.hypot(...way);
    if (length > 0) {
      const step = this.speed * this.factor * (this.isFast ? SHIFT : 1) * seconds / length;
      this.live.hold('flight');
      this.live.moveTo(cameras.fly(this.live.camera, ...way.map((x) => x * step), this.live.upAxis));
      this.live.flushInFrame();
    }
    this.ticking = requestAnimationFrame((next) => this.tick(next));
  }

  /// Asks a few times a second for the distance at the middle of the picture.
  async lookAhead(now) {
    if (now - this.lookedAt < LOOK_AHEAD_MS) return;
    this.lookedAt = now;
    const [width, height] = this.live.size;
    const hit = await this.live.pick(width / 2, height / 2);
    if (!this.isOn || !this.live.scene) return;
    this.target = this.speedFor(hit ? hit.distance : this.live.scene.size);
    if (hit) this.navigation.pivot = hit.position;
  }
}
