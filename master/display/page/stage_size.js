// The size of the view in pixels: the stage's in device pixels, times the chosen resolution, within the server's
// limits.

import { limitedSize } from './view_state.js';

/// A window that is being resized requests a picture after this pause.
const STILL_MS = 100;

export class StageSize {
  /// `onChange(size)` runs when another size is due.
  constructor(stage, onChange) {
    this.stage = stage;
    this.onChange = onChange;
    this.share = 1;
    this.limits = null;
    this.device = null;
    this.timer = 0;
    const observer = new ResizeObserver(([entry]) => {
      const box = entry.devicePixelContentBoxSize?.[0];
      this.device = box ? [box.inlineSize, box.blockSize] : null;
      clearTimeout(this.timer);
      this.timer = setTimeout(() => this.tell(), STILL_MS);
    });
    try {
      observer.observe(stage, { box: 'device-pixel-content-box' });
    } catch {
      observer.observe(stage);
    }
  }

  /// The size now due. Requires: limits are known.
  size() {
    const css = [this.stage.clientWidth, this.stage.clientHeight];
    const byRatio = css.map((x) => x * devicePixelRatio);
    // A browser that emulates another screen reports the boxes of the real one.
    const fits = this.device?.every((x, i) => Math.abs(x - byRatio[i]) < 2);
    return limitedSize(fits ? this.device : byRatio, this.share, this.limits);
  }

  setShare(share) {
    this.share = share;
    this.tell();
  }

  tell() {
    if (this.limits && this.stage.clientWidth && this.stage.clientHeight) this.onChange(this.size());
  }
}
