// The hint at the controls: shown until the first drag of this browser.

const KEY = 'quarry.hint';
const $ = (id) => document.getElementById(id);

export class Hint {
  constructor() {
    let isKnown = false;
    try {
      isKnown = localStorage.getItem(KEY) === 'known';
    } catch {
      // Storage may be forbidden; then each visit has the hint.
    }
    const isTouch = matchMedia('(pointer: coarse)').matches;
    $('hint').textContent = isTouch ? 'Drag with one finger to turn the model, with two to move and zoom.'
      : 'Drag to turn the model, drag with the right button to move it, turn the wheel to zoom, click a part to name it. Press ? for help.';
    $('hint').hidden = isKnown;
  }

  /// A person has dragged: the controls are known.
  known() {
    if ($('hint').hidden) return;
    $('hint').hidden = true;
    try {
      localStorage.setItem(KEY, 'known');
    } catch {
      // As above.
    }
  }
}
