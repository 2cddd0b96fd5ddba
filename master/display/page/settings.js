// Settings of this browser: how frames are sent and how fine the picture is. They are kept between visits.

const KEY = 'quarry.settings';
/// Whether the server accepts a value; another value would end the connection.
const PERMITTED = {
  frame_rate: (x) => x >= 10 && x <= 60, quality: (x) => Number.isInteger(x) && x >= 30 && x <= 95, step: (x) => [0, 1, 2, 4].includes(x),
  wait: (x) => typeof x === 'boolean', owners: (x) => typeof x === 'boolean', resolution: (x) => [1, 0.5, 0.25].includes(x),
};
const DEFAULTS = { frame_rate: 30, quality: 80, step: 0, wait: false, owners: false, resolution: 1 };
/// The settings that are sent to the server; the others concern only the page.
const SENT = ['frame_rate', 'quality', 'step', 'wait', 'owners'];

export class Settings {
  constructor(connection, onChange) {
    this.connection = connection;
    this.onChange = onChange;
    this.values = { ...DEFAULTS };
    try {
      const kept = JSON.parse(localStorage.getItem(KEY)) ?? {};
      for (const name of Object.keys(DEFAULTS)) {
        if (PERMITTED[name](kept[name])) this.values[name] = kept[name];
      }
    } catch {
      // Storage may be forbidden or hold something else; then the defaults are used.
    }
    // Settings without a visible effect are not kept for the next visit.
    this.values.owners = false;
  }

  set(name, value) {
    if (this.values[name] === value) return;
    this.values[name] = value;
    try {
      localStorage.setItem(KEY, JSON.stringify(this.values));
    } catch {
      // As above.
    }
    if (SENT.includes(name)) this.send();
    this.onChange(name);
  }

  send() {
    this.connection.send({ type: 'settings', ...Object.fromEntries(SENT.map((name) => [name, this.values[name]])) });
  }
}
