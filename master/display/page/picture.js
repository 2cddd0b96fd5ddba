// The picture: decodes frames, draws them in order and acknowledges them.

import { workerColour } from './colours.js';

/// Options of decoding: the canvas gets exactly the bytes of the file.
const DECODE = { colorSpaceConversion: 'none', premultiplyAlpha: 'none' };
const TYPES = { jpeg: 'image/jpeg', png: 'image/png' };
/// Span over which frames a second are counted, ms.
const RATE_SPAN_MS = 2000;

/// Draws on `canvas`, and the workers' tiles on `ownersCanvas` above it. `onDrawn(header)` runs after each frame.
export class Picture {
  constructor(canvas, ownersCanvas, onDrawn) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d', { alpha: false, colorSpace: 'srgb', willReadFrequently: false });
    this.context.fillStyle = '#15171a';  // until the first frame
    this.context.fillRect(0, 0, canvas.width, canvas.height);
    this.ownersCanvas = ownersCanvas;
    this.onDrawn = onDrawn;
    this.generation = 0;
    this.tail = Promise.resolve();
    this.held = [];  // acknowledgements that wait until the tab is visible
    this.header = null;
    this.framesDrawn = 0;
    this.exactPng = null;
    this.latency = null;  // ms, from input to drawn, of the last input
    this.times = [];  // when the last frames were drawn, with their bytes
    document.addEventListener('visibilitychange', () => document.hidden || this.release());
  }

  /// Forgets frames of an ended connection that are not drawn yet.
  forget() {
    ++this.generation;
    this.held = [];
  }

  /// Takes a frame. Frames are decoded at the same time, and drawn one after the other.
  take(frame, acknowledge) {
    const generation = this.generation;
    const bitmaps = Promise.all(frame.images.map((image, i) => {
      const blob = new Blob([image], { type: TYPES[frame.header.stripes[i].format] });
      return createImageBitmap(blob, DECODE);
    })).catch((error) => {
      console.warn(`frame ${frame.header.frame} cannot be decoded:`, error);
      return null;
    });
    this.tail = this.tail.then(() => bitmaps).then((decoded) => {
      if (generation === this.generation) {
        if (decoded) this.draw(frame, decoded);
        this.acknowledge(acknowledge);
      }
      decoded?.forEach((bitmap) => bitmap.close());
    }).catch((error) => console.error(error));
  }

  /// Acknowledges, but not in a hidden tab, so that the server saves the work.
  acknowledge(send) {
    this.held.push(send);
    if (!document.hidden) this.release();
  }

  release() {
    for (const send of this.held.splice(0)) send();
  }

  draw({ header, images }, bitmaps) {
    const [width, height] = header.size;
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    bitmaps.forEach((bitmap, i) => this.drawStripe(bitmap, header.stripes[i], width));
    if (header.owners) this.drawOwners(header);
    this.exactPng = header.exact && header.stripes[0]?.format === 'png' ? images[0].slice() : null;
    this.count(header, images);
    this.header = header;
    this.onDrawn(header);
  }

  /// Draws a stripe, stretched where its image has one pixel for a square of `scale` pixels. The traced pixel is the
  /// square's first, so the image is moved by half a square; the free border at the end is drawn first.
  drawStripe(bitmap, { y, height, scale = 1 }, width) {
    const { context } = this;
    context.imageSmoothingEnabled = scale > 1;
    if (scale === 1) return context.drawImage(bitmap, 0, y);
    const across = bitmap.width * scale, down = bitmap.height * scale, half = (scale - 1) / 2;
    context.save();
    context.beginPath();
    context.rect(0, y, width, height);
    context.clip();
    context.drawImage(bitmap, 0, y, across, down);
    context.drawImage(bitmap, -half, y - half, across, down);
    context.restore();
  }

  count(header, images) {
    const now = performance.now();
    ++this.framesDrawn;
    this.times.push({ at: now, bytes: images.reduce((sum, image) => sum + image.length, 0) });
    while (this.times[0].at < now - RATE_SPAN_MS) this.times.shift();
    // Later frames of the same input refine its picture; only the first one answers the input.
    if (header.input !== this.header?.input) this.latency = now - header.time;
  }

  /// Of the last two seconds: {frames, bytes} a second.
  rates() {
    const now = performance.now();
    const recent = this.times.filter(({ at }) => at >= now - RATE_SPAN_MS);
    const seconds = RATE_SPAN_MS / 1000;
    return { frames: recent.length / seconds, bytes: recent.reduce((sum, { bytes }) => sum + bytes, 0) / seconds };
  }

  /// A frame may name the owners of some tiles only; the others keep theirs.
  drawOwners({ size, owners }) {
    const canvas = this.ownersCanvas;
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    const context = canvas.getContext('2d');
    for (const [x, y, width, height, worker] of owners) {
      context.clearRect(x, y, width, height);
      context.fillStyle = workerColour(worker, 0.3);
      context.fillRect(x, y, width, height);
      context.strokeStyle = workerColour(worker, 0.6);
      context.strokeRect(x + 0.5, y + 0.5, width - 1, height - 1);
    }
  }

  showOwners(isShown) {
    this.ownersCanvas.hidden = !isShown;
    if (!isShown) this.ownersCanvas.width = this.ownersCanvas.height = 1;
  }
}
