// Steps that can be taken back: hidden parts, colours, the section, measurements, kept views and notes.

/// Most steps that are remembered.
const MOST = 200;

export class History {
  /// `read()` returns the present state, `write(state)` puts one in place. States are not changed after they are read.
  constructor(read, write) {
    Object.assign(this, { read, write });
    this.reset();
  }

  reset() {
    this.undone = [];
    this.done = [];
  }

  /// Notes the state before a change.
  note() {
    this.done.push(this.read());
    if (this.done.length > MOST) this.done.shift();
    this.undone = [];
  }

  /// Forgets the last step if it has changed nothing.
  forgetSame() {
    if (JSON.stringify(this.done.at(-1)) === JSON.stringify(this.read())) this.done.pop();
  }

  /// Takes the last change back. Returns whether there was one.
  undo() { return this.step(this.done, this.undone); }
  redo() { return this.step(this.undone, this.done); }

  step(from, to) {
    if (from.length === 0) return false;
    to.push(this.read());
    this.write(from.pop());
    return true;
  }
}
