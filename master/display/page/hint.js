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
    $('hint').textContent = isTouch ? 'One finger turns the model, two move it and come nearer.'
      : 'Drag turns the model, with the right button it moves it, the wheel comes nearer. ? tells more.';
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
