// Keys: each does one thing, and all are let go when the window loses the focus.

const STEP = Math.PI / 45;  // of an arrow key, 4 degrees
const NEARER = 0.9;  // of a + key

const isTyping = ({ target }) => target instanceof HTMLElement
  && (target.isContentEditable || target.matches('textarea, select, input:not([type=checkbox]):not([type=radio]):not([type=range])'));
/// Keys with which a control that has the focus is operated.
const isOperating = ({ target, key }) => target instanceof HTMLElement
  && (target.matches('input[type=range], input[type=radio]') ? /^(Arrow|Home|End|Page)/.test(key)
    : target.matches('button, a, summary, input') && (key === 'Enter' || key === ' '));

/// `on`: showView(NUMBER), home(), help(), escape(), panel(), activity().
export function listenToKeys(live, navigation, flight, on) {
  const actions = {
    f: () => flight.toggle(), o: () => navigation.toggleProjection(),
    Home: on.home, h: on.home, 0: () => navigation.frameAll(),
    p: on.panel, t: on.activity,
    '+': () => (flight.isOn ? flight.faster(1.5) : navigation.nudgeNearer(NEARER)),
    '-': () => (flight.isOn ? flight.faster(1 / 1.5) : navigation.nudgeNearer(1 / NEARER)),
    ArrowLeft: () => navigation.nudge(STEP, 0), ArrowRight: () => navigation.nudge(-STEP, 0),
    ArrowUp: () => navigation.nudge(0, -STEP), ArrowDown: () => navigation.nudge(0, STEP),
  };
  actions['='] = actions['+'];
  for (let number = 1; number <= 7; ++number) actions[number] = () => on.showView(number);

  addEventListener('keydown', (event) => {
    if (event.key === 'Escape') return on.escape();
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event) || isOperating(event)) return;
    if (event.key === '?') return on.help();
    if (!live.view || document.querySelector('dialog[open]')) return;
    flight.isFast = event.shiftKey;
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
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
