// Sentences over the last picture while there is no newer one, with a button where it helps.

const $ = (id) => document.getElementById(id);
/// Shorter states are not shown, because they would flicker.
const PATIENCE_MS = 400;

const PAGES = {
  connecting: { title: 'Connecting', text: 'The page is requesting the model from the master.' },
  lost: { title: 'The master is gone', text: 'The page keeps looking for it, and shows this view again when the master is back.' },
  denied: { title: 'No access', text: 'This browser has no access. Open the address that “quarry view” printed; it contains the token.', button: 'Try again' },
  refused: { title: 'Connection refused', text: '', button: 'Try again' },
  outdated: { title: 'Version mismatch', text: '', button: 'Load again' },
  'no-workers': { title: 'No workers', text: 'No worker is connected. The picture continues when one joins.' },
  failed: { title: 'The picture failed', text: '' },
};

export class Overlays {
  /// `onButton(state)` runs when the button of a page is pressed.
  constructor(onButton) {
    this.connection = { state: 'connecting', text: '' };
    this.server = { state: 'ok', text: '' };
    this.timer = 0;
    $('overlay-button').addEventListener('click', () => onButton(this.shown.state));
    this.choose();
  }

  setConnection(state, text) {
    this.connection = { state, text };
    if (state !== 'open') this.server = { state: 'ok', text: '' };
    this.choose();
  }

  setServer(state, text) {
    this.server = { state, text };
    this.choose();
  }

  choose() {
    const { state } = this.connection;
    // A server without workers sends that state before it can describe the scene.
    const isServers = state === 'open' || (state === 'connecting' && this.server.state !== 'ok');
    this.shown = isServers ? this.server : this.connection;
    clearTimeout(this.timer);
    if (this.shown.state === 'connecting') this.timer = setTimeout(() => this.show(), PATIENCE_MS);
    else this.show();
  }

  show() {
    const { state, text } = this.shown, page = PAGES[state];
    $('overlay').hidden = !page;
    if (!page) return;
    $('overlay-title').textContent = state === 'lost' && text ? 'No live connection' : page.title;
    $('overlay-text').textContent = text || page.text;
    $('overlay-button').hidden = !page.button;
    $('overlay-button').textContent = page.button ?? '';
  }
}
