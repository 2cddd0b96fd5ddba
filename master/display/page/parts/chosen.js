// The chosen parts: in the tree and in the picture, where their boxes are drawn.

/// Most boxes that are drawn, and most parts that a range in the tree may have.
const MOST_BOXES = 200, MOST_RANGE = 2000;

export class Chosen {
  /// `onChange()` runs after each change, `tell(SENTENCE)` shows a sentence.
  constructor(drawing, onChange, tell) {
    Object.assign(this, { drawing, onChange, tell });
    this.parts = new Map();  // by id
    this.anchor = null;  // the row in the tree where a range begins
    this.range = null;  // a range whose parts are still being fetched: {number, model}
  }

  get paths() { return [...new Set([...this.parts.values()].map(({ path }) => path))]; }
  get size() { return this.parts.size; }
  has({ id }) { return this.parts.has(id); }

  set(parts) {
    this.parts = new Map(parts.map((part) => [part.id, part]));
    this.show();
  }

  clear() {
    if (this.size > 0) this.set([]);
  }

  /// Adds a part, or takes it away.
  toggle(part) {
    if (!this.parts.delete(part.id)) this.parts.set(part.id, part);
    this.show();
  }

  /// Takes a click on a row of the tree: with Ctrl it adds or takes away, with Shift it chooses the rows from the last one.
  clickRow(part, number, { ctrlKey, metaKey, shiftKey }, model) {
    if (shiftKey && this.anchor !== null) return this.setRange(number, model);
    if (!part) return;
    this.anchor = number;
    this.range = null;
    if (ctrlKey || metaKey) this.toggle(part);
    else this.set([part]);
  }

  setRange(number, model) {
    this.range = null;
    const from = Math.min(this.anchor, number), to = Math.max(this.anchor, number);
    if (to - from >= MOST_RANGE) return this.tell(`At most ${MOST_RANGE.toLocaleString('en')} parts are chosen at once.`);
    const rows = Array.from({ length: to - from + 1 }, (_, i) => model.row(from + i)?.part);
    if (rows.includes(undefined)) this.range = { number, model };
    this.set(rows.filter(Boolean));
  }

  /// More parts have been fetched.
  loaded() {
    if (this.range) this.setRange(this.range.number, this.range.model);
  }

  /// The box around all, [lower, upper], or null where none has triangles.
  get box() {
    const boxes = [...this.parts.values()].map(({ box }) => box).filter(Boolean);
    if (boxes.length === 0) return null;
    const fold = (side, choose) => [0, 1, 2].map((axis) => choose(...boxes.map((box) => box[side][axis])));
    return [fold(0, Math.min), fold(1, Math.max)];
  }

  show() {
    const boxes = [...this.parts.values()].filter(({ box }) => box).slice(0, MOST_BOXES);
    this.drawing.set('chosen', boxes.flatMap(({ box }) => ['under', 'over'].map((style) => ({ kind: 'box', points: box, style }))));
    this.onChange();
  }
}
