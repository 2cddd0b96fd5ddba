// The preview of a model that is being read: discs, and a camera that the hand moves as in the viewer.

import { frameBox, rounded } from './camera.js';
import { Discs, readDiscs } from './discs.js';
import { Pointers } from './input.js';
import { Navigation } from './navigation.js';
import { add, distance } from './vectors.js';
import { toFragment } from './view_state.js';

const FOV = 45;
/// From where a model is seen first, by its up axis: as common/scene/framing.cpp.
const FIRST = { z: [0.6, -1, 0.45], y: [0.6, 0.45, 1] };

export class Preview {
  /// `stage` holds the canvas. Throws where there is no WebGL 2.
  constructor(stage) {
    this.stage = stage;
    this.discs = new Discs(stage.querySelector('canvas'));
    this.hasMoved = false;
    this.waiting = 0;
    // Stands in for the viewer's LiveView, as far as gestures use it. No point can be picked.
    this.live = {
      view: null, scene: null,
      get camera() { return this.view.camera; },
      get size() { return this.view.size; },
      get upAxis() { return this.scene.up_axis; },
      pick: () => Promise.resolve(null),
      hold: () => { this.hasMoved = true; },
      release: () => {},
      flushInFrame: () => {},
      moveTo: (camera) => this.put(camera),
      change: ({ camera }) => this.put(camera),
    };
    const navigation = new Navigation(this.live, () => {}, () => [this.live.scene.lower, this.live.scene.upper]);
    const none = () => {};
    new Pointers(stage, this.live, navigation, { isOn: false }, { drag: none, click: none, doubleClick: none, hover: none, menu: none });
    addEventListener('resize', () => stage.isConnected && this.live.view && this.put(this.live.camera));
  }

  get isShown() { return this.live.view !== null; }

  /// Takes the bytes of ./discs. Returns what they say, or null.
  take(buffer) {
    const discs = readDiscs(buffer);
    if (!discs) return null;
    this.discs.set(discs);
    const { lower, upper, upAxis } = discs;
    this.offset = discs.offset;
    this.live.scene = { lower, upper, size: distance(lower, upper), up_axis: upAxis };
    this.live.view ??= { camera: null, size: this.size() };
    // While nobody has moved the camera, it keeps all that has been read in sight.
    if (!this.hasMoved) {
      const up = upAxis === 'y' ? [0, 1, 0] : [0, 0, 1];
      this.live.view.camera = frameBox({ eye: FIRST[upAxis], at: [0, 0, 0], up, fov: FOV }, this.size(), lower, upper);
    }
    this.put(this.live.camera);
    return discs;
  }

  size() {
    return [this.stage.clientWidth, this.stage.clientHeight].map((x) => Math.max(1, x));
  }

  put(camera) {
    this.live.view = { camera, size: this.size() };
    this.waiting ||= requestAnimationFrame(() => {
      this.waiting = 0;
      this.discs.draw(this.live.camera, this.live.size.map((x) => Math.round(x * devicePixelRatio)));
    });
  }

  /// The camera as the viewer's fragment; empty until somebody has moved it.
  fragment() {
    if (!this.hasMoved) return '';
    const { camera: own, scene } = this.live;
    const camera = rounded({ ...own, eye: add(own.eye, this.offset), at: add(own.at, this.offset) }, scene.size);
    const nowhere = { eye: [], at: [], up: [], fov: 0, ortho: 0 };
    return toFragment({ camera }, { camera: nowhere });
  }
}
