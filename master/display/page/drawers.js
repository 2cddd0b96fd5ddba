// The drawers of the page: each is opened by one button, and gives way where there is no room for two.

const $ = (id) => document.getElementById(id);
/// Drawers that take the same place in a wide window.
const SAME_PLACE = [['panel', 'kept']];

export class Drawers {
  /// `drawers`: by name, objects with isOpen and setOpen(IS_OPEN). Each has a button "tool-NAME".
  constructor(drawers) { this.drawers = drawers; }

  toggle(name) { this.setOpen(name, !this.drawers[name].isOpen); }

  setOpen(name, isOpen) {
    this.drawers[name].setOpen(isOpen);
    this.changed(name);
  }

  /// A drawer has been opened or closed.
  changed(name) {
    if (this.drawers[name].isOpen) this.makeRoom(name);
    for (const [each, drawer] of Object.entries(this.drawers)) {
      $(`tool-${each}`).setAttribute('aria-expanded', String(drawer.isOpen));
      document.body.classList.toggle(`has-${each}`, drawer.isOpen);
    }
  }

  makeRoom(name) {
    const others = this.isNarrow ? Object.keys(this.drawers) : SAME_PLACE.filter((same) => same.includes(name)).flat();
    for (const other of others) if (other !== name && this.drawers[other].isOpen) this.drawers[other].setOpen(false);
  }

  get isNarrow() { return matchMedia('(max-width: 720px)').matches; }

  /// Closes the drawers that cover the picture of a narrow window. Returns whether there was one.
  closeNarrow() {
    const open = this.isNarrow ? Object.keys(this.drawers).filter((name) => this.drawers[name].isOpen) : [];
    for (const name of open) this.setOpen(name, false);
    return open.length > 0;
  }
}
