// The panel of settings: each control shows a member of the view or a setting, and changes it.

import { isOrthographic } from './camera.js';
import { hexToRadiance, radianceToHex } from './colours.js';
import { element, shown } from './formats.js';
import { percent } from './frame.js';
import { LEAST_NOISE_SPP, NOISE_SPP, environmentOf, skyOf } from './view_state.js';

const $ = (id) => document.getElementById(id);
const SAMPLES = [1, 2, 4, 8, 16, 32, 64, 128, 256];
/// Wishes for the noise.
const NOISES = [0.2, 0.1, 0.05, 0.02, 0.01];
/// A slider counts as moving this long after its last step.
const SLIDER_MS = 200;
/// Controls of settings: id, name, how to read it, how to write its value out.
const SETTINGS = [
  { id: 'frame-rate', name: 'frame_rate', text: (x) => String(x) },
  { id: 'quality', name: 'quality', text: (x) => String(x) },
  { id: 'step', name: 'step' },
  { id: 'resolution', name: 'resolution' },
  { id: 'wait', name: 'wait' },
  { id: 'show-owners', name: 'owners' },
];

export class Panel {
  /// `app` has live, settings, navigation, flight, picture, share, toggleProjection(), showView(NAME) and
  /// showCamera(CAMERA).
  constructor(app) {
    Object.assign(this, app);
    this.bindCamera();
    this.bindPicture();
    this.bindSettings();
  }

  get isOpen() { return !$('panel').hidden; }

  setOpen(isOpen) {
    $('panel').hidden = !isOpen;
    this.refresh();
  }

  /// Changes the view by a slider.
  slide(members) {
    this.live.hold('slider', SLIDER_MS);
    this.live.change(members);
  }

  bindCamera() {
    $('views').addEventListener('click', ({ target }) => target.dataset.view && this.showView(target.dataset.view));
    $('cameras').addEventListener('change', ({ target }) => {
      const chosen = this.live.scene.cameras[Number(target.value)];
      if (chosen) this.showCamera(chosen.camera);
      target.value = '';
    });
    $('up-axis').addEventListener('change', ({ target }) => this.turnUp(target.value));
    $('projection').addEventListener('change', () => this.toggleProjection());
    $('fov').addEventListener('input', ({ target }) => this.slide({ camera: { ...this.live.camera, fov: Number(target.value) } }));
    $('speed').addEventListener('input', ({ target }) => this.flight.faster(2 ** Number(target.value) / this.flight.factor));
  }

  /// Shows the scene with another axis up, from the same named view as the first.
  turnUp(axis) {
    const { live } = this;
    live.change({ up_axis: axis === live.scene.up_axis ? undefined : axis });
    this.showViews();
    this.showView('iso');
  }

  /// Which named views there are.
  showViews() {
    for (const button of $('views').children) button.disabled = !this.live.namedViews?.[button.dataset.view];
  }

  bindPicture() {
    $('mode').addEventListener('change', ({ target }) => this.live.change({ mode: target.value }));
    $('spp').addEventListener('change', ({ target }) => this.live.change({ spp: Number(target.value) }));
    $('noise').addEventListener('change', ({ target }) => {
      const noise = Number(target.value) || undefined, { view } = this.live;
      if (!view.noise) this.plainSpp = view.spp;
      this.live.change({ noise, spp: noise ? Math.max(view.spp, NOISE_SPP) : this.plainSpp ?? Math.min(view.spp, SAMPLES.at(-1)) });
    });
    $('sky').addEventListener('change', ({ target }) => {
      const environment = target.value ? environmentOf({ ...this.live.view.environment, name: target.value }) : undefined;
      this.live.change({ environment, sky: undefined });
    });
    const slideSky = (members) => this.slide({ environment: { ...this.live.view.environment, ...members } });
    $('sky-turn').addEventListener('input', ({ target }) => slideSky({ turn: Number(target.value) }));
    $('sky-strength').addEventListener('input', ({ target }) => slideSky({ strength: 2 ** Number(target.value) }));
    $('edges').addEventListener('change', ({ target }) => this.live.change({ edges: target.checked }));
    $('exposure-automatic').addEventListener('change', ({ target }) => {
      this.live.change({ exposure: target.checked ? undefined : Number(this.shownExposure().toFixed(2)) });
    });
    $('exposure').addEventListener('input', ({ target }) => this.slide({ exposure: Number(target.value) }));
    $('tone').addEventListener('change', ({ target }) => this.live.change({ tonemap: target.value || undefined }));
    $('background-automatic').addEventListener('change', ({ target }) => {
      this.live.change({ background: target.checked ? undefined : hexToRadiance($('background').value, this.shownExposure(), this.tone) });
    });
    $('background').addEventListener('input', ({ target }) => {
      this.slide({ background: hexToRadiance(target.value, this.shownExposure(), this.tone) });
    });
  }

  bindSettings() {
    for (const { id, name } of SETTINGS) {
      const control = $(id);
      control.addEventListener(control.type === 'range' ? 'input' : 'change', () => {
        this.settings.set(name, control.type === 'checkbox' ? control.checked : Number(control.value));
      });
    }
  }

  /// The exposure of the picture on the screen, EV.
  shownExposure() {
    return this.live.view?.exposure ?? this.picture.header?.exposure ?? 0;
  }

  /// The tone curve of the picture on the screen.
  get tone() { return this.live.view.tonemap ?? this.live.mode?.tone; }

  /// Fills in the modes that the server has.
  setModes(modes) { $('mode').replaceChildren(...modes.map(({ name, label }) => element('option', { value: name }, label))); }

  /// Fills in the choices of a new scene.
  setScene(scene) {
    this.showViews();
    $('sky').replaceChildren(element('option', { value: '' }, 'By the lights'), ...(scene.environments ?? []).map(({ name }) => element('option', { value: name }, shown(name))));
    const own = scene.cameras ?? [];
    $('cameras-row').hidden = own.length === 0;
    $('cameras').replaceChildren(element('option', { value: '' }, 'Choose…'),
      ...own.map(({ name }, i) => element('option', { value: String(i) }, shown(name) || `Camera ${i + 1}`)));
  }

  /// Makes the controls show the view and the settings.
  refresh() {
    const { view } = this.live;
    if (!view || !this.isOpen) return;
    const isFlat = isOrthographic(view.camera);
    $('up-axis').value = this.live.upAxis;
    $('projection').value = isFlat ? 'orthographic' : 'perspective';
    this.showSlider('fov', view.camera.fov, `${Math.round(view.camera.fov)}°`);
    $('fov').disabled = isFlat;
    $('speed-row').hidden = !this.flight.isOn;
    this.showSlider('speed', Math.log2(this.flight.factor), `× ${Number(this.flight.factor.toPrecision(2))}`);
    $('mode').value = view.mode;
    $('edges').checked = Boolean(view.edges);
    this.refreshSamples(view);
    this.refreshSky(view);
    this.share.refresh();
    this.refreshPicture();
    for (const { id, name, text } of SETTINGS) {
      const control = $(id), value = this.settings.values[name];
      if (control.type === 'checkbox') control.checked = value;
      else if (text) this.showSlider(id, value, text(value));
      else control.value = String(value);
    }
  }

  /// The sky's rows are there in mode path, where the server has environments.
  refreshSky({ mode, environment }) {
    $('sky-row').hidden = mode !== 'path' || !this.live.scene?.environments?.length;
    for (const id of ['sky-turn-row', 'sky-strength-row']) $(id).hidden = $('sky-row').hidden || !environment;
    $('sky').value = environment ? skyOf(environment.name, this.live.scene?.environments)?.name : '';
    const turn = environment?.turn ?? 0, strength = environment?.strength ?? 1;
    this.showSlider('sky-turn', turn, `${Math.round(turn)}°`);
    this.showSlider('sky-strength', Math.log2(strength), `× ${Number(strength.toPrecision(2))}`);
  }

  refreshSamples({ spp, noise }) {
    const noises = [...new Set([...NOISES, noise])].filter(Number.isFinite).sort((a, b) => b - a);
    $('noise').replaceChildren(element('option', { value: '' }, 'By the samples'), ...noises.map((n) => element('option', { value: String(n) }, `Below ${percent(n)}`)));
    $('noise').value = noise ? String(noise) : '';
    $('spp-name').textContent = noise ? 'Samples a pixel at most' : 'Samples a pixel';
    const counts = [...new Set([...SAMPLES, spp, ...(noise ? [NOISE_SPP] : [])])].filter((n) => Number.isFinite(n) && (!noise || n >= LEAST_NOISE_SPP)).sort((a, b) => a - b);
    $('spp').replaceChildren(...counts.map((n) => element('option', { value: String(n) }, String(n))));
    $('spp').value = String(spp);
  }

  /// The controls that also depend on the picture on the screen.
  refreshPicture() {
    const { view } = this.live;
    if (!view || !this.isOpen) return;
    const exposure = this.shownExposure(), isAutomatic = view.exposure === undefined;
    $('exposure-automatic').checked = isAutomatic;
    $('exposure').disabled = isAutomatic;
    this.showSlider('exposure', exposure, `${exposure > 0 ? '+' : ''}${exposure.toFixed(1)} EV`);
    $('background-automatic').checked = view.background === undefined;
    if (view.background && document.activeElement !== $('background')) $('background').value = radianceToHex(view.background, exposure, this.tone);
    $('tone').value = view.tonemap ?? '';
  }

  showSlider(id, value, text) {
    if (Number($(id).value) !== value) $(id).value = String(value);
    $(`${id}-value`).textContent = text;
  }
}
