// Checks of the page's arithmetic for parts, sections, measurements and kept views. Usage: node tests/browser/logic_test.mjs
import assert from 'node:assert/strict';
import test from 'node:test';

import { beforeEye } from '../../master/display/page/marks/drawing.js';
import { framesThrough, keptText, readFile } from '../../master/display/page/kept/kept_file.js';
import { History } from '../../master/display/page/kept/history.js';
import { hexToRadiance, radianceToHex } from '../../master/display/page/colours.js';
import { checkedInside, fromFragment, toFragment } from '../../master/display/page/view_state.js';
import { nearestOnLine, planeInBox, roundedOut, sectionOf, sharedBox, withSide } from '../../master/display/page/section/cut.js';
import { roundLength, unitName, withUnit } from '../../master/display/page/marks/units.js';
import { FoundModel, TreeModel } from '../../master/display/page/parts/tree_model.js';
import { angleAt, legsOf, snapped } from '../../master/display/page/measure/snap.js';
import * as parts from '../../master/display/page/parts/shown_parts.js';
import { distance } from '../../master/display/page/vectors.js';

const CAMERA = { eye: [0, -10, 0], at: [0, 0, 0], up: [0, 0, 1], fov: 90 };
const SIZE = [400, 400];

test('a path names a part and all below it, and a star any letters', () => {
  for (const [entry, path, is] of [['a/b', 'a/b', true], ['a/b', 'a/b/c', true], ['a/b', 'a/bc', false], ['a/b', 'a', false], ['*', 'a/b', true],
    ['*/valve', 'a/b/valve', true], ['*/valve', 'a/b/valve/stem', true], ['*/valve', 'a/valves', false], ['a/*b', 'a/x/yb/c', true],
    ['a\\*', 'a\\*', true], ['a\\*', 'ab', false], ['a.c', 'abc', false], ['(a|b)*', '(a|b)c', true], ['a\\\\*', 'a\\\\x', true]]) {
    assert.equal(parts.names(entry, path), is, `${entry} ${path}`);
  }
});

test('hidden parts are shown again, and only some parts without the others', () => {
  let shown = parts.hidden({}, ['a/b']);
  shown = parts.hidden(shown, ['a']);
  assert.deepEqual(shown.hide, ['a'], 'a part above stands for those below');
  assert.ok(parts.isHidden(shown, 'a/b/c'));
  shown = parts.unhidden(shown, ['a/b']);
  assert.equal(shown.hide, undefined);
  shown = parts.isolated(parts.hidden({}, ['a', 'x']), ['a/b']);
  assert.deepEqual([shown.only, shown.hide], [['a/b'], ['x']]);
  assert.ok(parts.isHidden(shown, 'a/c') && !parts.isHidden(shown, 'a/b/c'));
  assert.deepEqual(parts.unhidden(shown, ['a/c']).only, ['a/b', 'a/c']);
  assert.deepEqual(parts.allShown(shown), { hide: undefined, only: undefined, colors: undefined });
});

test('of two colours the later counts, and a part takes its own back', () => {
  let shown = parts.coloured(parts.coloured({}, ['a'], [1, 0, 0]), ['a/b'], [0, 1, 0]);
  assert.deepEqual([parts.colourOf(shown, 'a/c'), parts.colourOf(shown, 'a/b')], [[1, 0, 0], [0, 1, 0]]);
  shown = parts.coloured(shown, ['a/b'], null);
  assert.equal(parts.colourOf(shown, 'a/b'), null);
  assert.deepEqual(parts.colourOf(shown, 'a/c'), [1, 0, 0]);
  const dimmed = parts.dimmed(shown, ['x']);
  assert.ok(parts.isDimmed(dimmed) && !parts.isDimmed(shown));
  assert.deepEqual(parts.undimmed(dimmed), shown);
  assert.deepEqual(parts.undimmed(parts.coloured(dimmed, ['a'], null)).colors, undefined);
});

test('rows of a tree are found without its other parts', () => {
  const list = total => ({ total, at: place => ({ id: place, children: 1000 }) });
  const tree = new TreeModel(() => list(1000));
  assert.equal(tree.rows, 1000);
  tree.open(tree.row(10));
  tree.open(tree.row(11));
  tree.open(tree.row(2500));
  assert.equal(tree.rows, 4000);
  for (let number = 0; number < tree.rows; ++number) {
    const row = tree.row(number);
    assert.equal(tree.numberOf(row.branch, row.place), number);
  }
  assert.deepEqual([tree.row(11).level, tree.row(12).level, tree.row(1012).level], [2, 3, 2]);
  assert.equal(tree.above(tree.row(12)), 11);
  assert.equal(tree.row(4000), null);
  assert.equal(tree.reveal([10, 5], [10, 5, 7]), tree.numberOf(tree.root.open.get(10).open.get(5), 7));
  assert.equal(new FoundModel(list(3)).rows, 3);
});

test('a corner goes before an edge, and an edge before the face', () => {
  const hit = { position: [0.3, 0, 0.3], corners: [[0, 0, 0], [4, 0, 0], [0, 0, 4]] };
  const at = point => [200 + point[0] * 20, 200 - point[2] * 20];
  assert.deepEqual(snapped(hit, CAMERA, SIZE, ...at([0.3, 0, 0.3]), 10), { point: [0, 0, 0], kind: 'corner' });
  const edge = snapped(hit, CAMERA, SIZE, ...at([2, 0, 0.3]), 10);
  assert.equal(edge.kind, 'edge');
  assert.ok(distance(edge.point, [2, 0, 0]) < 1e-12);
  assert.deepEqual(snapped(hit, CAMERA, SIZE, ...at([1.2, 0, 1.2]), 10), { point: hit.position, kind: 'face' });
  // An edge that runs away from the eye: the point on it is seen at the cursor.
  const deep = snapped({ position: [1, 0, 0], corners: [[1, 0, 0], [1, 30, 0], [9, 0, 9]] }, CAMERA, SIZE, 210, 203, 4);
  assert.equal(deep.kind, 'edge');
  assert.ok(distance(deep.point, [1, 10, 0]) < 1e-9, String(deep.point));
});

test('angles, legs and units', () => {
  assert.equal(angleAt([[1, 0, 0], [0, 0, 0], [0, 2, 0]]), 90);
  assert.ok(Number.isNaN(angleAt([[0, 0, 0], [0, 0, 0], [0, 2, 0]])));
  assert.deepEqual(legsOf([[0, 0, 0], [1, 2, 3]]), [[0, 0, 0], [1, 0, 0], [1, 2, 0], [1, 2, 3]]);
  assert.deepEqual([0.001, 1, 0.0254, 7].map(unitName), ['mm', 'units', 'in', 'units']);
  assert.equal(withUnit(1234.5678, 0.001), '1234.57\u00a0mm');
  assert.deepEqual([1, 1.99, 2, 4.9, 5, 9.9, 0.0312, 4e7].map(roundLength), [1, 1, 2, 2, 5, 5, 0.02, 2e7]);
});

test('lines behind the eye are cut, and those before it are whole', () => {
  const whole = [[0, 0, 0], [1, 5, 0]];
  assert.deepEqual(beforeEye(CAMERA, ...whole), whole);
  assert.equal(beforeEye(CAMERA, [0, -20, 0], [1, -11, 0]), null);
  const [near, far] = beforeEye(CAMERA, [0, -20, 0], [0, 0, 0]);
  assert.ok(near[1] > -10 && near[1] < -9.9 && far[1] === 0);
});

test('sections are checked, moved and drawn', () => {
  const box = [[0, 0, 0], [1, 2, 3]];
  assert.deepEqual(sectionOf({ box }), { box, caps: true });
  for (const bad of [null, {}, { box: [[0, 0, 0], [0, 1, 1]] }, { planes: [] }, { planes: [{ point: [0, 0, 0], normal: [0, 0, 0] }] },
    { planes: Array(13).fill({ point: [0, 0, 0], normal: [0, 0, 1] }) }, { box: [[0, 0, 'x'], [1, 1, 1]] }]) assert.equal(sectionOf(bad), undefined);
  assert.deepEqual(withSide(box, 1, 1, -5, 0.1)[1], [1, 0.1, 3]);
  assert.deepEqual(sharedBox(box, [[-1, 1, 1], [5, 5, 5]]), [[0, 1, 1], [1, 2, 3]]);
  assert.equal(sharedBox(box, [[4, 4, 4], [5, 5, 5]]), null);
  assert.deepEqual(roundedOut([[0, -1, 1e3], [16, 1.234, 1000.5]]), [[-0.01, -1.01, 999.99], [16.01, 1.24, 1000.51]]);
  assert.equal(planeInBox({ point: [0.5, 1, 1.4], normal: [1, 1, 1] }, [[0, 0, 0], [1, 2, 3]]).length, 5);
  assert.equal(planeInBox({ point: [0.5, 0.5, 0.5], normal: [1, 1, 1] }, [[0, 0, 0], [1, 1, 1]]).length, 6);
  assert.deepEqual(planeInBox({ point: [9, 9, 9], normal: [1, 0, 0] }, box), []);
  assert.equal(nearestOnLine([0, 0, 0], [1, 0, 0], { origin: [3, -5, 0], direction: [0, 1, 0] }), 3);
  assert.equal(nearestOnLine([0, 0, 0], [1, 0, 0], { origin: [3, 0, 0], direction: [1, 0, 0] }), null);
});

test('a link holds hidden parts, colours and the section; other text in it is ignored', () => {
  const home = { camera: CAMERA, mode: 'ao', spp: 4, size: [4, 3] };
  const view = { ...home, hide: ['a/b #2', 'ü'], only: ['*'], colors: [{ parts: ['a'], color: [0.1, 0.2, 0.3] }], section: { box: [[0, 0, 0], [1, 1, 1]], caps: false } };
  assert.deepEqual(fromFragment(toFragment(view, home), home, ['ao']), view);
  assert.deepEqual(fromFragment(toFragment({ ...home, tonemap: 'clip' }, home), home, ['ao']), { ...home, tonemap: 'clip' });
  const lit = { ...home, environment: { name: 'sunset, late', turn: 40, strength: 0.5 } };
  assert.deepEqual(fromFragment(toFragment(lit, home), home, ['ao']), lit);
  assert.deepEqual(fromFragment('#environment={"name":"x","turn":"far"}', home, ['ao']), home);
  const smooth = { ...home, noise: 0.05, spp: 4096 };
  assert.deepEqual(fromFragment(toFragment(smooth, home), home, ['ao']), smooth);
  assert.deepEqual(fromFragment(toFragment(home, smooth), smooth, ['ao']), home);
  assert.deepEqual(fromFragment('#noise=0.05', home, ['ao']), smooth);
  for (const noise of ['0', '2', 'low', '-1']) assert.deepEqual(fromFragment(`#noise=${noise}`, home, ['ao']), home);
  assert.deepEqual(fromFragment('#hide=[1]&only=x&section={}&tone=loud', home, ['ao']), home);
  assert.deepEqual(checkedInside({ ...home, only: [], hide: [] }).dropped, ['only']);
});

test('a chosen colour is the radiance that shows it, by either tone curve', () => {
  for (const tone of ['clip', 'film']) {
    for (const hex of ['#000000', '#204060', '#c0d0e0', '#f8fafb']) assert.equal(radianceToHex(hexToRadiance(hex, 1.5, tone), 1.5, tone), hex);
  }
  assert.ok(hexToRadiance('#e0e0e0', 0, 'film')[0] > hexToRadiance('#e0e0e0', 0, 'clip')[0]);
  assert.equal(radianceToHex([0.3, 0.3, 0.3], 0, 'film'), radianceToHex([0.3, 0.3, 0.3], 0, 'clip'));
});

test('a file of kept views is read again, and others are named', () => {
  const kept = { views: [{ name: 'a', view: { camera: CAMERA }, measures: [{ kind: 'distance', points: [[0, 0, 0], [1, 1, 1]] }] }],
                 notes: [{ text: 'b', point: [1, 2, 3], view: { camera: CAMERA } }] };
  assert.deepEqual(readFile(keptText(kept, { name: 'n', scene_id: 'i' })), { kept, scene_id: 'i' });
  assert.deepEqual(readFile(JSON.stringify({ camera: CAMERA })).view, { camera: CAMERA });
  assert.equal(readFile(JSON.stringify({ frames: [CAMERA] })).path.frames.length, 1);
  for (const text of ['', '3', '[]', '{}', '{"camera":1}', '{"frames":[{}]}', '{"format":"quarry kept views","version":2,"views":[],"notes":[]}',
    '{"format":"quarry kept views","version":1,"views":[null],"notes":[]}', '{"format":"quarry kept views","version":1}']) {
    assert.match(readFile(text).error, /^The file|^View|^The camera/, text);
  }
});

test('a path passes its key cameras', () => {
  const other = { ...CAMERA, eye: [10, 0, 0] };
  const frames = framesThrough([CAMERA, other, CAMERA], 10, 'z');
  assert.equal(frames.length, 21);
  assert.deepEqual([frames[0], frames[10], frames[20]], [CAMERA, other, CAMERA]);
  assert.equal(framesThrough([CAMERA, { ...CAMERA, ortho: 3 }], 4, 'z')[2].ortho, 3);
});

test('steps are taken back and done again', () => {
  let state = 0;
  const history = new History(() => state, value => { state = value; });
  for (const next of [1, 2, 3]) {
    history.note();
    state = next;
  }
  history.undo();
  history.undo();
  assert.equal(state, 1);
  history.redo();
  assert.equal(state, 2);
  history.note();
  state = 9;
  assert.ok(!history.redo());
  history.undo();
  assert.equal(state, 2);
});
