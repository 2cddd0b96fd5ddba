// The WebSocket to the master: opened, watched, and opened again when it is lost.

import { FrameError, parseFrame } from './frame.js';

const FIRST_PAUSE_MS = 500;
const LONGEST_PAUSE_MS = 5000;
/// A server that does not answer for this long is given up. Its welcome may take longer: it waits for the scene.
const ANSWER_MS = 10000;
/// The server sends its statistics each second. After this much silence the connection is lost.
const SILENCE_MS = 8000;
const PROTOCOL = 1;
const NO_WEB_SOCKETS = 'The server answers, but no live connection reaches it: a proxy or filter in between blocks WebSockets. '
  + 'The page keeps trying.';

/// A connection that is opened again whenever it is lost. `on` has the functions
///   state(NAME, SENTENCE): 'connecting', 'open', 'lost', 'denied', 'refused' or 'outdated'
///   welcome(MESSAGE), message(MESSAGE), frame({header, images}, ACKNOWLEDGE)
/// 'lost' is tried again by itself; 'denied', 'refused' and 'outdated' only by retry().
export class Connection {
  constructor(on) {
    this.on = on;
    this.socket = null;
    this.isOpen = false;
    this.pause = FIRST_PAUSE_MS;
    this.timer = 0;
    this.isDenied = false;
    this.word = '';  // names the try, to ask why it was refused
    this.heard = 0;
    setInterval(() => this.isOpen && performance.now() - this.heard > SILENCE_MS && this.lose(), 1000);
    addEventListener('online', () => this.hurry());
    document.addEventListener('visibilitychange', () => document.hidden || this.hurry());
    // Another tab may have opened the page with the token meanwhile.
    document.addEventListener('visibilitychange', () => !document.hidden && this.isDenied && this.retry());
  }

  /// Connects at once, whatever the state.
  retry() {
    clearTimeout(this.timer);
    this.drop();
    this.pause = FIRST_PAUSE_MS;
    this.on.state('connecting', '');
    this.open();
  }

  /// Sends an object. Returns whether there was a connection.
  send(message) {
    if (!this.isOpen) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  /// Ends a pause between two tries.
  hurry() {
    if (!this.timer) return;
    clearTimeout(this.timer);
    this.timer = 0;
    this.open();
  }

  open() {
    this.timer = 0;
    this.isDenied = false;
    const address = new URL('live', document.baseURI);
    address.protocol = address.protocol === 'https:' ? 'wss:' : 'ws:';
    this.word = Array.from(crypto.getRandomValues(new Uint32Array(2)), (x) => x.toString(36)).join('');
    address.search = `?try=${this.word}`;
    address.hash = '';
    const socket = this.socket = new WebSocket(address);
    socket.binaryType = 'arraybuffer';
    const late = setTimeout(() => this.socket === socket && this.lose(), ANSWER_MS);
    socket.onopen = () => {
      clearTimeout(late);
      if (this.socket === socket) this.on.state('connecting', '');
    };
    socket.onmessage = (event) => this.socket === socket && this.receive(socket, event.data);
    socket.onclose = () => {
      clearTimeout(late);
      if (this.socket === socket) this.lose();
    };
  }

  receive(socket, data) {
    this.heard = performance.now();
    try {
      if (typeof data === 'string') return this.hear(JSON.parse(data));
      const frame = parseFrame(data);
      const acknowledge = () => {
        if (this.socket === socket && this.isOpen) this.send({ type: 'ack', frame: frame.header.frame });
      };
      this.on.frame(frame, acknowledge);
    } catch (error) {
      if (!(error instanceof FrameError || error instanceof SyntaxError)) throw error;
      this.stop('refused', 'The server sent a message that this page does not understand.');
    }
  }

  hear(message) {
    if (message.type === 'error') return this.stop('refused', message.message);
    if (message.type !== 'welcome') return this.on.message(message);
    if (message.protocol !== PROTOCOL) {
      return this.stop('outdated', 'The server has another version than this page. Load the page again.');
    }
    this.isOpen = true;
    this.pause = FIRST_PAUSE_MS;
    this.on.state('open', '');
    this.on.welcome(message);
  }

  /// Drops the socket without another try.
  drop() {
    const socket = this.socket;
    this.socket = null;
    this.isOpen = false;
    socket?.close();
  }

  stop(state, sentence) {
    this.drop();
    this.on.state(state, sentence);
  }

  /// The connection has ended without a reason: asks for one by HTTP, and tries again after a pause.
  async lose() {
    const wasOpen = this.isOpen;
    this.drop();
    this.on.state('lost', '');
    // A connection that had its welcome was permitted; only a refused one needs a reason.
    const answer = wasOpen ? null : await askForReason(this.word);
    if (this.socket || this.timer) return;
    this.isDenied = answer?.state === 'denied';
    if (answer) this.on.state(answer.state, answer.sentence);
    if (answer && answer.state !== 'lost') return;
    this.timer = setTimeout(() => this.open(), this.pause * (0.8 + 0.2 * Math.random()));
    this.pause = Math.min(this.pause * 2, LONGEST_PAUSE_MS);
  }
}

/// The reason of a refused WebSocket, which browsers hide from scripts: {state, sentence}, or null while the server is
/// away.
async function askForReason(word) {
  try {
    const answer = await fetch(new URL('./', document.baseURI), { cache: 'no-store' });
    if (answer.status === 403) return { state: 'denied', sentence: '' };
    if (answer.status === 503 && /^text\/plain/.test(answer.headers.get('Content-Type') || '')) {
      return { state: 'refused', sentence: (await answer.text()).trim().slice(0, 500) };
    }
    const health = answer.ok && await fetch(new URL('healthz', document.baseURI), { cache: 'no-store' });
    if (!health || !health.ok || (await health.text()).trim() !== 'ok') return null;
    const reason = await fetch(new URL(`refusal?try=${word}`, document.baseURI), { cache: 'no-store' });
    return { state: 'lost', sentence: reason.ok ? `${(await reason.text()).trim()} The page keeps trying.` : NO_WEB_SOCKETS };
  } catch {
    // No answer: the server is away.
  }
  return null;
}
