// Plays a path: the cameras of its frames, one after the other, in motion.

export class Player {
  /// `onChange()` runs when it begins or ends.
  constructor(live, onChange) {
    this.live = live;
    this.onChange = onChange;
    this.isOn = false;
    this.ticking = 0;
  }

  play(frames, perSecond) {
    this.stop();
    this.isOn = true;
    this.onChange();
    this.live.hold('path');
    const began = performance.now();
    const step = (now) => {
      const frame = Math.min(frames.length - 1, Math.floor(Math.max(0, now - began) / 1000 * perSecond));
      this.live.change({ camera: frames[frame] });
      if (frame === frames.length - 1) return this.stop();
      this.live.flushInFrame();
      this.ticking = requestAnimationFrame(step);
    };
    this.ticking = requestAnimationFrame(step);
  }

  stop() {
    if (!this.isOn) return;
    this.isOn = false;
    cancelAnimationFrame(this.ticking);
    this.live.release('path');
    this.onChange();
  }
}
