// The selections of parts that the server has made: a view names one by its id, instead of long lists of paths.

import { toWire } from '../view_state.js';

/// Longest message to the server, in bytes, and most paths in it; it takes a little more.
const LONGEST = 1e6, MOST_PATHS = 50000;

/// The members of a view that make its selection; null: all parts are shown as they are.
function wanted({ hide, only, colors }) {
  const members = { hide, only, colors };
  return Object.values(members).some((member) => member !== undefined) ? members : null;
}

function isTooLong({ hide = [], only = [], colors = [] }, text) {
  const paths = colors.reduce((sum, { parts }) => sum + parts.length, hide.length + only.length);
  return paths > MOST_PATHS || new TextEncoder().encode(text).length > LONGEST;
}

export class Selections {
  /// `onChange()` runs when the server has answered, `onError(SENTENCE, MEMBERS)` when it takes no such selection;
  /// MEMBERS belong to the last selection that it has taken.
  constructor(connection, onChange, onError) {
    Object.assign(this, { connection, onChange, onError });
    this.live = null;  // set once, before the connection opens
    this.reset();
  }

  /// Forgets all: the connection, or the scene, is another.
  reset() {
    this.made = new Map([['null', { box: null, hidden: 0 }]]);  // by key: {id, box, hidden}
    this.asked = [];  // keys whose answers come, in this order
    this.last = null;  // the key that views name until the newest one is made
  }

  /// The view in the server's form. Null on a new connection until the selection is made: without it the server would load
  /// parts that are not shown.
  message(view) {
    const key = JSON.stringify(wanted(view));
    if (this.made.has(key)) this.last = key;
    if (this.last === null) return null;
    const id = this.made.get(this.last)?.id;
    return !id ? toWire(view) : { ...toWire(view), selection: id };
  }

  /// Asks the server for the selection of the present view, if it is new.
  ask() {
    const { view } = this.live;
    if (!view || !this.connection.isOpen) return;
    const members = wanted(view), key = JSON.stringify(members);
    if (this.made.has(key) || this.asked.includes(key)) return;
    if (isTooLong(members, key)) return this.refuse('So many single parts cannot be sent. Choose a part above them.');
    this.asked.push(key);
    this.connection.send({ type: 'select', ...members });
  }

  /// Whether the server has not made the selection of the view yet.
  get isWaiting() { return this.live.view !== null && !this.made.has(JSON.stringify(wanted(this.live.view))); }

  /// The box of the parts that are shown, [lower, upper], or null: all are.
  get box() { return this.made.get(JSON.stringify(wanted(this.live.view ?? {})))?.box ?? null; }

  /// Takes an answer.
  take({ id, hidden, shown_box: box, error, unknown }) {
    if (unknown !== undefined) return this.forget(unknown);
    const key = this.asked.shift();
    if (key === undefined) return;
    if (error) return this.refuse(error);
    this.made.set(key, { id, box: box ?? null, hidden });
    this.onChange();
  }

  /// The server has forgotten a selection, as after its restart.
  forget(id) {
    for (const [key, { id: own }] of this.made) if (own === id) this.made.delete(key);
    if (!this.made.has(this.last)) this.last = null;
    this.ask();
  }

  refuse(sentence) {
    this.onError(sentence, { hide: undefined, only: undefined, colors: undefined, ...JSON.parse(this.last ?? 'null') });
  }
}
