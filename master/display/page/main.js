// Starts the page and ties its parts together.

import { Activity } from './activity.js';
import { fitAspect, isOrthographic, opposite } from './camera.js';
import { Connection } from './connection.js';
import { Drawers } from './drawers.js';
import { Flight } from './flight.js';
import { shown } from './formats.js';
import { Hint } from './hint.js';
import { Hud } from './hud.js';
import { Pointers } from './input.js';
import { Inside } from './inside.js';
import { Kept } from './kept/kept.js';
import { listenToKeys } from './keyboard.js';
import { Link, removeToken } from './link.js';
import { LiveView } from './live_view.js';
import { Navigation } from './navigation.js';
import { Overlays } from './overlays.js';
import { Panel } from './panel.js';
import { Mark, PickCard } from './pick.js';
import { Picture } from './picture.js';
import { Selections } from './parts/selections.js';
import { Settings } from './settings.js';
import { Share } from './share.js';
import { StageSize } from './stage_size.js';
import { checkedInside, fromWire, ownMembers, skyOf, toFile } from './view_state.js';

const $ = (id) => document.getElementById(id);
const VIEWS = ['iso', 'top', 'front', 'back', 'left', 'right', 'inside'];
/// Time for which a sentence is shown: enough to read it.
const TOAST_MS = 2500, LETTER_MS = 45;

removeToken();

const connection = new Connection({ state: connectionState, welcome, message, frame: (frame, done) => picture.take(frame, done) });
const selections = new Selections(connection, () => inside.selectionMade(), (sentence, members) => inside.selectionRefused(sentence, members));
const live = new LiveView(connection, selections, viewChanged, () => link.write());
selections.live = live;
const kept = new Kept(() => inside.keptPanel.show(), tell);
const picture = new Picture($('picture'), $('owners'), frameDrawn);
const settings = new Settings(connection, settingChanged);
const pivot = new Mark($('pivot'), live), marker = new Mark($('marker'), live);
const navigation = new Navigation(live, (point) => pivot.put(point), () => inside.seenBox());
const flight = new Flight(live, navigation, flightChanged);
const link = new Link(live, kept, tell, (view) => replaceView({ ...view, size: live.size }));
const hud = new Hud(live, picture);
const overlays = new Overlays((state) => (state === 'outdated' ? location.reload() : connection.retry()));
const activity = new Activity();
const card = new PickCard(live, marker, tell);
const share = new Share({ live, connection, picture, link, tell, wholeView, defaults: () => defaults, isExact });
const panel = new Panel({ live, settings, navigation, flight, picture, share, toggleProjection, showView, showCamera });
const inside = new Inside({
  live, navigation, selections, kept, share, card, tell, wholeView, replaceView,
  defaults: () => defaults, onDrawer: (name) => drawers.changed(name), onCrosshair: () => showCrosshair(),
});
const drawers = new Drawers({ panel, activity, ...inside.drawers });
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
  Object.assign(live, { scene, modes: message.modes, defaults });
  selections.reset();
  const size = stageSize.size(), camera = fromWire(message.view.camera);
  link.home = { ...ownMembers(message.view), size, camera: scene.interior ? camera : fitAspect(camera, size) };
  settings.send();
  activity.restart();
  if (isSame) {
    dropUnknownSky(scene.environments);
    stageSize.tell();
  } else {
    navigation.reset();
    card.close();
    flight.stop();
    live.endHolds();
    inside.sceneChanged(scene.scene_id);
    live.view = isFirst ? link.read(location.hash) : link.home;
    dropUnknownSky(scene.environments);
    viewChanged();
    document.title = `${shown(scene.name)} – Quarry`;
    panel.setModes(message.modes);
    panel.setScene(scene);
    panel.refresh();
  }
  selections.ask();
  live.reconnected();
  link.write();
}

/// Takes an environment that the server does not have out of the view.
function dropUnknownSky(known) {
  const { environment, ...rest } = live.view;
  if (!environment || skyOf(environment.name, known)) return;
  live.view = rest;
  tell(`The server has no sky “${shown(environment.name)}”.`);
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
  else if (message.type === 'selection') selections.take(message);
  else if (message.type === 'refused' || message.type === 'notice') tell(message.message);
  if (message.type === 'refused') inside.refused();
  else if (message.type === 'state') overlays.setServer(message.state, message.message);
}

function viewChanged() {
  marker.place();
  pivot.place();
  panel.refresh();
  inside.viewChanged();
  const isFlat = isOrthographic(live.camera);
  $('tool-ortho').setAttribute('aria-pressed', String(isFlat));
}

function frameDrawn(header) {
  hud.drawn(header);
  inside.frameDrawn(header);
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
  showCrosshair();
  $('stage').classList.toggle('flying', flight.isOn);
  if (!flight.isOn && document.pointerLockElement) document.exitPointerLock();
  panel.refresh();
}

function showCrosshair() { $('crosshair').hidden = !flight.isOn && !inside.isByKeys; }

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

const toggles = Object.fromEntries(['panel', 'activity', 'parts', 'section', 'measure', 'kept'].map((name) => [name, () => live.view && drawers.toggle(name)]));
const showHelp = () => ($('help').open ? $('help').close() : $('help').showModal());

/// Escape ends the innermost thing.
function escape() {
  if ($('help').open) return;  // the dialog closes itself
  if (inside.escape()) return;
  if (flight.isOn) flight.stop();
  else drawers.closeNarrow();
}

new Pointers($('stage'), live, navigation, flight, {
  drag: () => hint.known(),
  click: (x, y, event) => inside.click(x, y, event),
  doubleClick: (x, y) => navigation.centre(x, y),
  hover: (x, y) => inside.hover(x, y),
  menu: (place) => inside.menu(place),
});
listenToKeys(live, navigation, flight, VIEWS, {
  showView, home: goHome, frame: frameAll, projection: toggleProjection, help: showHelp, escape, ...toggles,
  hide: () => inside.parts.hide(), isolate: () => inside.parts.isolate(), showAll: () => inside.parts.showAll(),
  undo: () => inside.undo(), redo: () => inside.redo(), clickMiddle: () => inside.clickMiddle(), menuMiddle: () => inside.menuMiddle(),
});
const tools = { home: goHome, frame: frameAll, fly: () => flight.toggle(), ortho: toggleProjection, help: showHelp, ...toggles };
for (const [name, use] of Object.entries(tools)) $(`tool-${name}`).addEventListener('click', use);

/// The whole view, as `quarry render --view` reads it.
function wholeView() {
  if (!live.view) return null;
  const { sky, ...rest } = defaults;  // the default sky belongs to the default lights
  return { ...rest, ...(sky && !live.view.lights && !live.view.environment ? { sky } : {}), lights: live.lights(defaults.lights), ...toFile(live.view, live.scene.environments) };
}

/// Whether the picture on the screen is the exact picture of the newest view.
function isExact() { return connection.isOpen && Boolean(picture.header?.exact) && hud.isNewest; }

/// For tests and for the console: the state of the page, and a way to change the view.
window.quarry = {
  state: () => ({
    connection: hud.connection, header: picture.header, input: live.input, framesDrawn: picture.framesDrawn, latency: picture.latency,
    isExact: isExact(), isFlying: flight.isOn, limits, chosen: inside.parts.chosen.paths, measured: inside.measure.list.map((one) => inside.measure.text(one)),
  }),
  lastExactPng: () => picture.exactPng,
  /// Shows a view; members that are missing have the default's values. Returns its input number, or null when it could
  /// not be sent.
  setView(view) {
    return replaceView({ ...checkedInside({ ...link.home, size: live.size, ...view }).view, camera: fromWire(view.camera ?? link.home.camera) });
  },
  view: wholeView,
};

connection.open();
