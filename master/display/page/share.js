// Sharing: links, the view as a file, the command that renders it, and pictures of any size.

import { copyText, milliseconds } from './formats.js';
import { command } from './command.js';
import { download, downloadBytes, fileName } from './downloads.js';

const $ = (id) => document.getElementById(id);
const LOOPBACK = ['localhost', '127.0.0.1', '[::1]'];
const MOST_SIDE = 65536;
const TOO_LONG = 'The view is too long for a link, and this browser has no room to keep it. Save the view instead.';
const ONLY_HERE = 'It shows this view in this browser only, because the view is too long for a link. Save the view for others.';

export class Share {
  /// `app` has live, connection, picture, link, tell(SENTENCE) and wholeView(): the view with all members.
  constructor(app) {
    Object.assign(this, app);
    this.saves = 0;
    this.isSaving = false;
    const uses = {
      'copy-link': () => this.copyLink(), 'copy-access': () => this.copyAccess(), 'save-view': () => this.saveView(),
      'copy-command': () => this.copyCommand(), 'save-picture': () => this.savePicture(), 'save-cancel': () => this.cancel(),
    };
    for (const [id, use] of Object.entries(uses)) $(id).addEventListener('click', use);
    $('full-screen').addEventListener('click', () => {
      if (document.fullscreenElement) document.exitFullscreen();
      else document.documentElement.requestFullscreen?.().catch(() => this.tell('The browser did not allow full screen.'));
    });
    $('full-screen').hidden = !document.fullscreenEnabled;
  }

  async copy(text, sentence) {
    this.tell(await copyText(text) ? sentence : 'The browser did not allow copying.');
  }

  /// Advice for colleagues, beside a link to this page.
  get reach() {
    return LOOPBACK.includes(location.hostname)
      ? ` It names this machine (${location.hostname}); from other machines it opens through ssh -L ${location.port || 80}:localhost:${location.port || 80}.` : '';
  }

  copyLink() {
    const address = this.link.address();
    if (!address) return this.tell(TOO_LONG);
    if (this.link.isKept(address)) return this.copy(address, `The link is copied. ${ONLY_HERE}`);
    return this.copy(address, `The link is copied. It opens for people with access; others need “Copy link with access”.${this.reach}`);
  }

  /// The link with the token: it gives access to anybody.
  async copyAccess() {
    const token = await this.token();
    if (!token) return this.tell('The server did not send the token. Copy the address that “quarry view” printed.');
    const own = this.link.address();
    if (!own) return this.tell(TOO_LONG);
    const address = new URL(own);
    address.searchParams.set('token', token);
    return this.copy(address.href, `The link is copied. Anybody with this link can see the model.${this.link.isKept(own) ? ` ${ONLY_HERE}` : this.reach}`);
  }

  async token() {
    try {
      const answer = await fetch(new URL('access', document.baseURI), { cache: 'no-store' });
      return answer.ok ? (await answer.text()).trim() : '';
    } catch {
      return '';
    }
  }

  get name() { return fileName(this.live.scene.name); }

  /// The size in the page's fields; for an invalid one shows a sentence and returns null.
  size() {
    const size = ['save-width', 'save-height'].map((id) => Number($(id).value));
    if (size.every((x) => Number.isInteger(x) && x >= 1 && x <= MOST_SIDE)) return size;
    this.tell(`A picture is 1 to ${MOST_SIDE} pixels wide and high.`);
    return null;
  }

  /// The view to share, with the size in the fields, or null.
  view() {
    const size = this.live.view && this.size();
    return size ? { ...this.wholeView(), size } : null;
  }

  saveView() {
    const view = this.view();
    if (!view) return;
    downloadBytes([JSON.stringify(view, null, 1), '\n'], 'application/json', `${this.name}.view.json`);
    this.tell('The view is saved. quarry render --view reads the file.');
  }

  copyCommand() {
    const view = this.view();
    if (!view) return null;
    return this.copy(command(this.live.scene, this.defaults(), view, `${this.name}.png`), 'The command is copied. Run it on the machine that has the model.');
  }

  /// Saves the image on the screen when it is the exact picture; else the cluster renders it.
  savePicture() {
    const view = this.view();
    if (!view || this.isSaving) return;
    const png = this.isExact() && String(view.size) === String(this.live.size) && this.picture.exactPng;
    if (png) return downloadBytes([png], 'image/png', `${this.name}.png`);
    const own = this.live.message();
    if (!own || !this.connection.send({ type: 'save', save: ++this.saves, view: { ...own, size: view.size } })) return this.tell('There is no connection now.');
    this.isSaving = true;
    this.beganAt = performance.now();
    this.showProgress(0);
  }

  cancel() {
    this.connection.send({ type: 'save', save: ++this.saves });
    this.stop('The picture is cancelled.');
  }

  stop(sentence) {
    this.isSaving = false;
    $('save-progress').hidden = true;
    $('save-picture').disabled = false;
    if (sentence) this.tell(sentence);
  }

  showProgress(done) {
    $('save-progress').hidden = false;
    $('save-picture').disabled = true;
    $('save-bar').value = done;
  }

  /// Handles the server's news of the picture.
  take({ save, done, file, error }) {
    if (save !== this.saves || !this.isSaving) return;
    if (error) return this.stop(`The picture cannot be saved: ${error}`);
    if (!file) return this.showProgress(done);
    download(new URL(file, document.baseURI).href, `${this.name}.png`);
    this.stop(`The picture is saved; it took ${milliseconds(performance.now() - this.beganAt)}.`);
  }

  /// A pending picture is lost with its connection.
  connectionLost() {
    if (this.isSaving) this.stop('The connection was lost before the picture was saved. Save it again.');
  }

  /// Fills in the size of the view, unless a person has typed another.
  refresh() {
    const { size } = this.live;
    if (String(this.filled ?? '') === String(size)) return;
    const isOwn = !this.filled || ['save-width', 'save-height'].every((id, i) => Number($(id).value) === this.filled[i]);
    this.filled = size;
    if (isOwn) ['save-width', 'save-height'].forEach((id, i) => { $(id).value = String(size[i]); });
  }
}
