// Keys: each does one thing, and all are released when the window loses the focus.

const STEP = Math.PI / 45;  // of an arrow key, 4 degrees
const NEARER = 0.9;  // of a + key

/// The number pad looks as in Blender: from the front, the right and above, with Ctrl from the other side.
const PAD_VIEWS = { Numpad1: ['front', 'back'], Numpad3: ['right', 'left'], Numpad7: ['top', 'bottom'] };

const isTyping = ({ target }) => target instanceof HTMLElement
  && (target.isContentEditable || target.matches('textarea, select, input:not([type=checkbox]):not([type=radio]):not([type=range])'));
/// Whether a key operates the focused control.
const isOperating = ({ target, key }) => target instanceof HTMLElement
  && (target.matches('input[type=range], input[type=radio]') ? /^(Arrow|Home|End|Page)/.test(key)
    : target.matches('button, a, summary, input') && (key === 'Enter' || key === ' '));

/// The action of a key of the number pad, with or without Num Lock.
function padAction({ code, ctrlKey }, navigation, on) {
  const [view, opposite] = PAD_VIEWS[code] ?? [];
  if (view) return () => on.showView(ctrlKey ? opposite : view);
  const others = {
    Numpad5: on.projection, Numpad0: on.home,
    Numpad4: () => navigation.nudge(STEP, 0), Numpad6: () => navigation.nudge(-STEP, 0),
    Numpad8: () => navigation.nudge(0, -STEP), Numpad2: () => navigation.nudge(0, STEP),
  };
  return ctrlKey ? undefined : others[code];
}

/// Whether a key works on the picture itself, and not on a control.
const isOnStage = ({ target }) => target === document.body || target.id === 'stage';

/// The action of a key with Ctrl or Cmd, or none: it is the browser's.
function commandAction({ key, shiftKey, altKey }, on) {
  const name = altKey ? '' : key.toLowerCase();
  if (name === 'z') return shiftKey ? on.redo : on.undo;
  return name === 'y' ? on.redo : undefined;
}

/// `on`: showView(NAME), home(), frame(), projection(), help(), escape(), undo(), redo(); a function for each drawer; and
/// for the parts hide(), isolate(), showAll(), clickMiddle() and menuMiddle(). `views`: names by number.
export function listenToKeys(live, navigation, flight, views, on) {
  const actions = {
    g: () => flight.toggle(), o: on.projection,
    Home: on.home, f: on.frame, 0: on.frame,
    p: on.panel, t: on.activity, l: on.parts, k: on.kept, x: on.section, m: on.measure, h: on.hide, i: on.isolate,
    '+': () => (flight.isOn ? flight.faster(1.5) : navigation.nudgeNearer(NEARER)),
    '-': () => (flight.isOn ? flight.faster(1 / 1.5) : navigation.nudgeNearer(1 / NEARER)),
    ArrowLeft: () => navigation.nudge(STEP, 0), ArrowRight: () => navigation.nudge(-STEP, 0),
    ArrowUp: () => navigation.nudge(0, -STEP), ArrowDown: () => navigation.nudge(0, STEP),
  };
  actions['='] = actions['+'];
  views.forEach((name, i) => { actions[i + 1] = () => on.showView(name); });

  addEventListener('keydown', (event) => {
    if (event.key === 'Escape') return on.escape();
    const pad = padAction(event, navigation, on), isPad = /^Numpad\d$/.test(event.code);
    const command = (event.ctrlKey || event.metaKey) && !isPad && !isTyping(event) ? commandAction(event, on) : undefined;
    if (command && live.view && !document.querySelector('dialog[open]')) {
      event.preventDefault();
      return command();
    }
    if (event.metaKey || event.altKey || (event.ctrlKey && !pad) || isTyping(event) || isOperating(event)) return;
    if (event.key === '?') return on.help();
    if (!live.view || document.querySelector('dialog[open]')) return;
    flight.isFast = event.shiftKey;
    let action = isPad ? pad : actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (event.shiftKey && event.key.toLowerCase() === 'h') action = on.showAll;
    if (isOnStage(event) && event.key === 'Enter') action = on.clickMiddle;
    if (isOnStage(event) && (event.key === 'ContextMenu' || (event.key === 'F10' && event.shiftKey))) action = on.menuMiddle;
    if (flight.press(event.code)) event.preventDefault();
    else if (action) {
      event.preventDefault();
      action();
    }
  });
  addEventListener('keyup', (event) => {
    flight.isFast = event.shiftKey;
    flight.release(event.code);
  });
  addEventListener('blur', () => flight.letGo());
  document.addEventListener('visibilitychange', () => document.hidden && flight.letGo());
}
