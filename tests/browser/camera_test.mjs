// Checks of the page's camera maths. Usage: node tests/browser/camera_test.mjs
import assert from 'node:assert/strict';
import test from 'node:test';

import { command, quoted } from '../../master/display/page/command.js';
import { shown } from '../../master/display/page/formats.js';
import * as camera from '../../master/display/page/camera.js';
import { cross, distance, dot, subtract } from '../../master/display/page/vectors.js';

const SIZE = [640, 480];
const UP = { y: [0, 1, 0], z: [0, 0, 1] };

function near(actual, expected, tolerance = 1e-9) {
  assert.ok(Math.abs(actual - expected) <= tolerance, `${actual} is not ${expected}`);
}

function nearPoint(actual, expected, tolerance = 1e-9) {
  expected.forEach((x, i) => near(actual[i], x, tolerance));
}

/// Numbers in [0, 1), the same in each run.
function randoms(seed) {
  let state = seed;
  return () => {
    state = (state * 1664525 + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

/// Upright cameras around the origin, half of them orthographic, each with its up axis and a point that it sees.
function samples(count = 200) {
  const next = randoms(40);
  return Array.from({ length: count }, (_, i) => {
    const upAxis = i % 2 ? 'y' : 'z';
    const eye = [next() * 20 - 10, next() * 20 - 10, next() * 20 - 10];
    const spec = { eye, at: [next(), next(), next()], up: UP[upAxis], fov: 20 + next() * 80 };
    if (i % 4 < 2) spec.ortho = 1 + next() * 10;
    const pixel = [next() * SIZE[0], next() * SIZE[1]];
    return { spec, upAxis, pixel, point: camera.pointAt(spec, SIZE, ...pixel, 0.5 + next() * 10), next };
  });
}

const isUpright = (spec, upAxis) => near(dot(camera.axes(spec).right, UP[upAxis]), 0);

test('foreign names are shown without control codes and marks of direction', () => {
  assert.equal(shown('a\u001b[31mb\u202ec\u0007'), 'a\ufffd[31mb\ufffdc\ufffd');
  assert.equal(shown('Anlage Süd プラント (1)'), 'Anlage Süd プラント (1)');
});

test('a command is one line for a shell, whatever the names', () => {
  assert.equal(quoted('/a/b.quarry'), '/a/b.quarry');
  assert.equal(quoted("it's $HOME `x`"), "'it'\\''s $HOME `x`'");
  const view = { camera: { eye: [-1, 2, 3], at: [0, 0, 0], up: [0, 0, 1], fov: 45 }, size: [4, 3], mode: 'ao', spp: 4, seed: 0 };
  assert.equal(command({ store: '-a.quarry' }, view, view, '-x.png'),
    'quarry render ./-a.quarry -o ./-x.png --size=4x3 --mode=ao --spp=4 --eye=-1,2,3 --at=0,0,0 --up=0,0,1 --fov=45');
  assert.match(command({ store: 'a.quarry' }, view, { ...view, seed: 3 }, 'x.png'), /^printf %s '.*"seed":3.*' > x.view.json && quarry render a.quarry -o x.png --view x.view.json$/);
});

test('a projected point is found again by its ray', () => {
  for (const { spec, pixel, point } of samples()) {
    const seen = camera.project(spec, SIZE, point);
    near(seen.x, pixel[0], 1e-7);
    near(seen.y, pixel[1], 1e-7);
    nearPoint(camera.pointAt(spec, SIZE, seen.x, seen.y, seen.depth), point, 1e-8);
  }
});

test('a pixel has the same ray as in the renderer', () => {
  // Worked by hand from view_basis.h: looking along +y, z up, 90 degrees: a pixel is 2 / 480 wide at distance 1.
  const spec = { eye: [0, 0, 0], at: [0, 5, 0], up: [0, 0, 1], fov: 90 };
  const { direction } = camera.rayOf(spec, SIZE, 560, 0);
  nearPoint(direction, [1, 1, 1].map((x) => x / Math.sqrt(3)));
});

test('a point behind a perspective camera is not seen', () => {
  assert.equal(camera.project({ eye: [0, 0, 0], at: [0, 1, 0], up: [0, 0, 1], fov: 45 }, SIZE, [0, -1, 0]), null);
});

test('pan moves the point under the cursor with it', () => {
  for (const { spec, point, next } of samples()) {
    const x = next() * SIZE[0], y = next() * SIZE[1];
    const seen = camera.project(camera.pan(spec, SIZE, point, x, y), SIZE, point);
    near(seen.x, x, 1e-7);
    near(seen.y, y, 1e-7);
    near(seen.depth, camera.depthOf(spec, point), 1e-9);
  }
});

test('dolly keeps the point under the cursor and scales its size', () => {
  for (const { spec, point, pixel, next } of samples()) {
    const factor = 0.2 + next() * 2;
    const after = camera.dolly(spec, SIZE, point, factor);
    const seen = camera.project(after, SIZE, point);
    near(seen.x, pixel[0], 1e-6);
    near(seen.y, pixel[1], 1e-6);
    const before = camera.pixelSize(spec, SIZE, camera.depthOf(spec, point));
    near(camera.pixelSize(after, SIZE, seen.depth) / before, factor, 1e-9);
  }
});

test('orbit keeps the distance to the pivot, its place in the picture, and the camera upright', () => {
  for (const { spec, upAxis, point, pixel, next } of samples()) {
    const after = camera.orbit(spec, point, next() * 4 - 2, next() * 4 - 2, upAxis);
    near(distance(after.eye, point), distance(spec.eye, point), 1e-9);
    near(camera.viewDistance(after), camera.viewDistance(spec), 1e-9);
    const seen = camera.project(after, SIZE, point);
    near(seen.x, pixel[0], 1e-6);
    near(seen.y, pixel[1], 1e-6);
    isUpright(after, upAxis);
  }
});

test('a whole turn ends where it began', () => {
  for (const { spec, upAxis, point } of samples(20)) {
    let turned = spec;
    for (let step = 0; step < 100; ++step) turned = camera.orbit(turned, point, 2 * Math.PI / 100, 0, upAxis);
    nearPoint(turned.eye, spec.eye, 1e-9);
    nearPoint(turned.at, spec.at, 1e-9);
  }
});

test('orbit stops at the poles, and turns there', () => {
  for (const { spec, upAxis, point } of samples()) {
    for (const pitch of [3, -3]) {
      const pole = camera.orbit(spec, point, 0, pitch, upAxis);
      near(camera.turntable(pole, upAxis).pitch, Math.sign(pitch) * Math.PI / 2, 1e-7);
      isUpright(pole, upAxis);
      const turned = camera.orbit(pole, point, 1, 0, upAxis);
      near(dot(camera.axes(turned).right, camera.axes(pole).right), Math.cos(1), 1e-6);
      assert.ok(Math.hypot(...cross(turned.up, subtract(turned.at, turned.eye))) > 0);
      const back = camera.orbit(pole, point, 0, -Math.sign(pitch), upAxis);
      near(camera.turntable(back, upAxis).pitch, Math.sign(pitch) * (Math.PI / 2 - 1), 1e-6);
    }
  }
});

test('a view from the top orbits without a jump', () => {
  const top = { eye: [3, 4, 20], at: [3, 4, 0], up: [0, 1, 0], fov: 45 };
  const turned = camera.orbit(top, top.at, 1e-6, 0, 'z');
  nearPoint(camera.axes(turned).right, [1, 0, 0], 1e-5);
  nearPoint(camera.axes(turned).up, [0, 1, 0], 1e-5);
});

test('a rolled camera is upright after its first turn', () => {
  const rolled = { eye: [5, 5, 5], at: [0, 0, 0], up: [1, 0, 0.2], fov: 45 };
  const turned = camera.orbit(rolled, [0, 0, 0], 0, 0, 'z');
  isUpright(turned, 'z');
  nearPoint(camera.axes(turned).forward, camera.axes(rolled).forward);
});

test('looking around keeps the eye', () => {
  for (const { spec, upAxis } of samples(20)) {
    const after = camera.look(spec, 0.3, 0.1, upAxis);
    nearPoint(after.eye, spec.eye);
    near(camera.turntable(after, upAxis).heading - camera.turntable(spec, upAxis).heading, 0.3, 2 * Math.PI + 1e-9);
  }
});

test('a positive yaw looks to the right, a positive pitch up', () => {
  for (const upAxis of ['y', 'z']) {
    const spec = { eye: [0, 0, 0], at: upAxis === 'y' ? [0, 0, -1] : [0, 1, 0], up: UP[upAxis], fov: 45 };
    const ahead = subtract(camera.look(spec, 0.1, 0.1, upAxis).at, spec.eye);
    assert.ok(dot(ahead, camera.axes(spec).right) > 0.05);
    assert.ok(dot(ahead, UP[upAxis]) > 0.05);
  }
});

test('flying moves along the look and the scene\'s up', () => {
  const spec = { eye: [1, 2, 3], at: [1, 7, 3], up: [0, 0, 1], fov: 45 };
  nearPoint(camera.fly(spec, 1, 2, 3, 'z').eye, [2, 5, 5]);
  nearPoint(camera.fly(spec, 1, 2, 3, 'z').at, [2, 10, 5]);
});

test('the toggle of projections keeps the size and place of what lies at the pivot', () => {
  for (const { spec, pixel, point } of samples()) {
    const depth = camera.depthOf(spec, point);
    const other = spec.ortho ? camera.toPerspective(spec, depth) : camera.toOrthographic(spec, depth);
    const seen = camera.project(other, SIZE, point);
    near(seen.x, pixel[0], 1e-6);
    near(seen.y, pixel[1], 1e-6);
    near(camera.pixelSize(other, SIZE, seen.depth), camera.pixelSize(spec, SIZE, depth), 1e-9);
  }
});

test('a framed box is completely visible and fills the picture', () => {
  for (const { spec, next } of samples()) {
    const lower = [-next() * 5, -next() * 5, -next() * 5], upper = [1 + next(), 1 + next(), 1 + next()];
    const framed = camera.frameBox(spec, SIZE, lower, upper);
    let most = 0;
    for (let corner = 0; corner < 8; ++corner) {
      const point = [0, 1, 2].map((axis) => (corner >> axis & 1 ? upper : lower)[axis]);
      const seen = camera.project(framed, SIZE, point);
      most = Math.max(most, Math.abs(seen.x / SIZE[0] * 2 - 1), Math.abs(seen.y / SIZE[1] * 2 - 1));
    }
    near(most, 0.95, 1e-6);
  }
});

test('a camera for 4:3 shows as much in a narrow picture, and stays in a wide one', () => {
  const spec = { eye: [0, -10, 0], at: [0, 0, 0], up: [0, 0, 1], fov: 45 };
  assert.equal(camera.fitAspect(spec, [640, 480]), spec);
  assert.equal(camera.fitAspect(spec, [1920, 1080]), spec);
  const wide = camera.project(spec, [640, 480], [3, 0, 0]).x / 640;
  near(camera.project(camera.fitAspect(spec, [360, 720]), [360, 720], [3, 0, 0]).x / 360, wide);
});

test('an orthographic camera outside the box has the whole box in front', () => {
  const spec = { eye: [2, -1.5, 0], at: [0, 0, 0], up: [0, 0, 1], fov: 45, ortho: 3 };
  const back = camera.aheadOfBox(spec, [-1, -1, -1], [1, 1, 1]);
  assert.ok(camera.depthOf(back, [1, -1, 1]) > 0);
  const point = [0.3, 0.2, -0.1];
  near(camera.project(back, SIZE, point).x, camera.project(spec, SIZE, point).x, 1e-9);
  const inside = { ...spec, eye: [0.5, 0, 0] };
  assert.equal(camera.aheadOfBox(inside, [-1, -1, -1], [1, 1, 1]), inside);
});

test('the middle of the picture looks at a centred point', () => {
  for (const { spec, point } of samples(40)) {
    const seen = camera.project(camera.centred(spec, SIZE, point), SIZE, point);
    near(seen.x, SIZE[0] / 2, 1e-6);
    near(seen.y, SIZE[1] / 2, 1e-6);
  }
});

test('a glide has exact ends and passes between them', () => {
  const from = { eye: [0, -10, 1], at: [0, 0, 0], up: [0, 0, 1], fov: 45 };
  const to = { eye: [0, 10, 1], at: [0, 0, 0], up: [0, 0, 1], fov: 60 };
  assert.equal(camera.between(from, to, 0, 'z'), from);
  assert.equal(camera.between(from, to, 1, 'z'), to);
  const half = camera.between(from, to, 0.5, 'z');
  near(camera.viewDistance(half), camera.viewDistance(from), 1e-9);
  isUpright(half, 'z');
});

test('rounding moves nothing visibly, and is stable', () => {
  for (const { spec } of samples(40)) {
    const once = camera.rounded(spec, 20);
    nearPoint(once.eye, spec.eye, 1e-8);
    assert.deepEqual(camera.rounded(once, 20), once);
  }
});
