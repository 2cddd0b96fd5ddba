// Starts the page and ties its parts together.

import { Activity } from './activity.js';
import { fitAspect, isOrthographic, opposite } from './camera.js';
import { Connection } from './connection.js';
import { Flight } from './flight.js';
import { shown } from './formats.js';
import { Hint } from './hint.js';
import { Hud } from './hud.js';
import { Pointers } from './input.js';
import { listenToKeys } from './keyboard.js';
import { Link, removeToken } from './link.js';
import { LiveView } from './live_view.js';
import { Navigation } from './navigation.js';
import { Overlays } from './overlays.js';
import { Panel } from './panel.js';
import { Mark, PickCard } from './pick.js';
import { Picture } from './picture.js';
import { Settings } from './settings.js';
import { Share } from './share.js';
import { StageSize } from './stage_size.js';
import { fromWire, ownMembers, toWire } from './view_state.js';

const $ = (id) => document.getElementById(id);
const VIEWS = ['iso', 'top', 'front', 'back', 'left', 'right', 'inside'];
/// Time for which a sentence is shown: enough to read it.
const TOAST_MS = 2500, LETTER_MS = 45;

removeToken();

const connection = new Connection({ state: connectionState, welcome, message, frame: (frame, done) => picture.take(frame, done) });
const live = new LiveView(connection, viewChanged, () => link.write());
const picture = new Picture($('picture'), $('owners'), frameDrawn);
const settings = new Settings(connection, settingChanged);
const pivot = new Mark($('pivot'), live), marker = new Mark($('marker'), live);
const navigation = new Navigation(live, (point) => pivot.put(point));
const flight = new Flight(live, navigation, flightChanged);
const link = new Link(live, (view) => replaceView({ ...view, size: live.size }));
const hud = new Hud(live, picture);
const overlays = new Overlays((state) => (state === 'outdated' ? location.reload() : connection.retry()));
const activity = new Activity();
const card = new PickCard(live, marker, tell);
const share = new Share({ live, connection, picture, link, tell, wholeView, defaults: () => defaults, isExact });
const panel = new Panel({ live, settings, navigation, flight, picture, share, toggleProjection, showView, showCamera });
const hint = new Hint();
const stageSize = new StageSize($('stage'), (size) => {
  if (live.view && String(size) !== String(live.size)) live.change({ size });
});
let limits = null, defaults = {};

function connectionState(state, text) {
  if (state === 'lost') picture.forget();
  if (state !== 'open') share.connectionLost();
  hud.setConnection(state);
  overlays.setConnection(state, text);
}

/// Another scene starts with its default view; the same scene keeps its view.
function welcome(message) {
  const { scene } = message, isSame = live.scene?.scene_id === scene.scene_id;
  const isFirst = !live.scene;
  stageSize.limits = limits = message.limits;
  defaults = message.view;
  link.modes = message.modes.map(({ name }) => name);
  stageSize.share = settings.values.resolution;
  live.scene = scene;
  const size = stageSize.size(), camera = fromWire(message.view.camera);
  link.home = { ...ownMembers(message.view), size, camera: scene.interior ? camera : fitAspect(camera, size) };
  settings.send();
  activity.restart();
  if (isSame) {
    stageSize.tell();
  } else {
    navigation.reset();
    card.close();
    flight.stop();
    live.endHolds();
    live.view = isFirst ? link.read(location.hash) : link.home;
    viewChanged();
    document.title = `${shown(scene.name)} – Quarry`;
    panel.setModes(message.modes);
    panel.setScene(scene);
    panel.refresh();
  }
  live.reconnected();
  link.write();
}

/// Replaces the shown view, and any motion, by a whole view.
function replaceView(view) {
  navigation.stopGlide();
  return live.replace(view);
}

function message(message) {
  if (message.type === 'picked') {
    live.picked(message);
    if (message.error) tell(message.error);
  }
  if (message.type === 'stats') activity.take(message);
  else if (message.type === 'saved') share.take(message);
  else if (message.type === 'refused' || message.type === 'notice') tell(message.message);
  else if (message.type === 'state') overlays.setServer(message.state, message.message);
}

function viewChanged() {
  marker.place();
  pivot.place();
  panel.refresh();
  const isFlat = isOrthographic(live.camera);
  $('tool-ortho').setAttribute('aria-pressed', String(isFlat));
}

function frameDrawn(header) {
  hud.drawn(header);
  panel.refreshPicture();
}

function settingChanged(name) {
  if (name === 'owners') {
    picture.showOwners(settings.values.owners);
    if (settings.values.owners) live.resend();
  }
  if (name === 'resolution') stageSize.setShare(settings.values.resolution);
  panel.refresh();
}

function flightChanged() {
  $('tool-fly').setAttribute('aria-pressed', String(flight.isOn));
  $('crosshair').hidden = !flight.isOn;
  $('stage').classList.toggle('flying', flight.isOn);
  if (!flight.isOn && document.pointerLockElement) document.exitPointerLock();
  panel.refresh();
}

function tell(sentence) {
  $('toast').textContent = sentence;
  $('toast').hidden = false;
  clearTimeout(tell.timer);
  tell.timer = setTimeout(() => { $('toast').hidden = true; }, Math.max(TOAST_MS, LETTER_MS * sentence.length));
}

function showCamera(camera) {
  navigation.show(fitAspect(fromWire(camera), live.size));
}

function showView(name) {
  const views = live.scene && live.namedViews, camera = views?.[name] ?? (name === 'bottom' && views?.top ? opposite(views.top) : null);
  if (!camera) return tell(`This model has no view “${name}”.`);
  if (name === 'inside') navigation.show(fromWire(camera));
  else showCamera(camera);
}

/// Flight needs a perspective: it ends when the view becomes orthographic.
function toggleProjection() {
  if (!live.view) return;
  flight.stop();
  navigation.toggleProjection();
}

const frameAll = () => live.view && navigation.frameAll();
const goHome = () => live.view && navigation.glideTo(link.home.camera);

/// Opens one drawer and closes the other where both do not fit.
function setOpen(opened, isOpen) {
  const isNarrow = matchMedia('(max-width: 720px)').matches;
  const drawers = { panel, activity };
  drawers[opened].setOpen(isOpen);
  if (isOpen && isNarrow) drawers[opened === 'panel' ? 'activity' : 'panel'].setOpen(false);
  for (const [name, drawer] of Object.entries(drawers)) {
    $(`tool-${name}`).setAttribute('aria-expanded', String(drawer.isOpen));
    document.body.classList.toggle(`has-${name}`, drawer.isOpen);
  }
}
const togglePanel = () => setOpen('panel', !panel.isOpen);
const toggleActivity = () => setOpen('activity', !activity.isOpen);
const showHelp = () => ($('help').open ? $('help').close() : $('help').showModal());

/// Escape ends the innermost thing.
function escape() {
  if ($('help').open) return;  // the dialog closes itself
  if (card.isOpen) card.close();
  else if (flight.isOn) flight.stop();
  else if (panel.isOpen && matchMedia('(max-width: 720px)').matches) togglePanel();
}

new Pointers($('stage'), live, navigation, flight, {
  drag: () => hint.known(),
  click: () => navigation.lastPick.then((hit) => card.show(hit)),
  doubleClick: (x, y) => navigation.centre(x, y),
});
listenToKeys(live, navigation, flight, VIEWS, {
  showView, home: goHome, frame: frameAll, projection: toggleProjection, help: showHelp, escape, panel: togglePanel, activity: toggleActivity,
});
const tools = {
  home: goHome, frame: frameAll, fly: () => flight.toggle(),
  ortho: toggleProjection, activity: toggleActivity, panel: togglePanel, help: showHelp,
};
for (const [name, use] of Object.entries(tools)) $(`tool-${name}`).addEventListener('click', use);

/// The whole view, as `quarry render --view` reads it.
function wholeView() { return live.view ? { ...defaults, lights: live.lights(defaults.lights), ...toWire(live.view) } : null; }

/// Whether the picture on the screen is the exact picture of the newest view.
function isExact() { return connection.isOpen && Boolean(picture.header?.exact) && hud.isNewest; }

/// For tests and for the console: the state of the page, and a way to change the view.
window.quarry = {
  state: () => ({
    connection: hud.connection, header: picture.header, input: live.input, framesDrawn: picture.framesDrawn, latency: picture.latency,
    isExact: isExact(), isFlying: flight.isOn, limits,
  }),
  lastExactPng: () => picture.exactPng,
  /// Shows a view; members that are missing have the default's values. Returns its input number, or null when it could
  /// not be sent.
  setView(view) {
    return replaceView({ ...link.home, size: live.size, ...view, camera: fromWire(view.camera ?? link.home.camera) });
  },
  view: wholeView,
};

connection.open();
