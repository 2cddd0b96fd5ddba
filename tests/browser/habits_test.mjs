// Habits of users on a page with a model: keys, wheel, touch, tabs, the browser's own shortcuts; and a cluster that has little time.
import assert from 'node:assert/strict';
import http from 'node:http';
import { after, before, test } from 'node:test';
import { Cluster } from './cluster.mjs';
import { apart, drawnBy, errors, exactOf, eyeOf, launch, open as openIn, pause, shoot, SIZE, untilExact, viewOf, visit } from './viewing.mjs';

const cluster = new Cluster();
let browser, page;
const open = (url, options) => openIn(browser, url, options);
const direction = ({ eye, at }) => { const d = at.map((x, i) => x - eye[i]), n = Math.hypot(...d); return d.map(x => x / n); };
const distance = ({ eye, at }) => apart(eye, at);

async function rest(of = page) {
  await untilExact(of);
  return (await viewOf(of)).camera;
}

before(async () => {
  await cluster.begin(100000);
  cluster.addWorker();
  browser = await launch();
  page = await open(cluster.url);
  await untilExact(page);
});

after(async () => {
  await browser?.close();
  await cluster.end();
});

test('a hint is shown at the controls until the first drag, and screen readers get the state in words', async () => {
  assert.ok(await page.locator('#hint').isVisible());
  await shoot(page, 'hint');
  await page.waitForFunction(() => document.getElementById('spoken').textContent === 'The picture is exact.');
  assert.equal(await page.locator('#spoken').getAttribute('aria-live'), 'polite');
  await pause(2500);  // rates are of the last two seconds
  await page.click('#status');
  await page.keyboard.press('t');
  await page.waitForFunction(() => /viewer/.test(document.getElementById('activity-summary').innerText));
  const text = await page.locator('body').innerText();
  for (const word of [/step \d/, /0\.0 frames/, /abandoned/, /suspended/, /waiting for \d/]) assert.doesNotMatch(text, word);
  await shoot(page, 'words');
  await page.keyboard.press('t');
  await page.click('#status');
  await page.mouse.move(320, 300);
  await page.mouse.down();
  await page.mouse.move(380, 320, { steps: 5 });
  await page.mouse.up();
  assert.ok(!await page.locator('#hint').isVisible());
  await page.reload();
  await untilExact(page);
  assert.ok(!await page.locator('#hint').isVisible());
});

test('F frames, G flies, O ends the flight, the number pad looks as in Blender', async () => {
  const views = await page.evaluate(() => new Promise(resolve => {
    const socket = new WebSocket(new URL('live', document.baseURI).href.replace('http', 'ws'));
    socket.onmessage = ({ data }) => { socket.close(); resolve(JSON.parse(data).scene.views); };
  }));
  const towards = (camera, name, sign = 1) => {
    const wanted = direction(views[name]).map(x => sign * x);
    assert.ok(apart(direction(camera), wanted) < 1e-3, `${name}: ${direction(camera)} is ${wanted}`);
  };
  for (const [key, name, sign] of [['Numpad1', 'front', 1], ['Numpad3', 'right', 1], ['Numpad7', 'top', 1], ['Control+Numpad1', 'back', 1],
    ['Control+Numpad3', 'left', 1], ['Control+Numpad7', 'top', -1], ['3', 'front', 1], ['2', 'top', 1]]) {
    await page.keyboard.press(key);
    await pause(400);
    towards(await rest(), name, sign);
  }
  await page.keyboard.press('1');
  await pause(400);
  const framed = await rest();
  for (let i = 0; i < 8; ++i) await page.keyboard.press('-');
  assert.ok(distance(await rest()) > 1.5 * distance(framed));
  await page.keyboard.press('f');
  await pause(400);
  assert.ok(distance(await rest()) < 1.5 * distance(framed));
  await page.keyboard.press('g');
  assert.ok(await page.evaluate(() => window.quarry.state().isFlying));
  await page.keyboard.press('o');
  assert.ok(!await page.evaluate(() => window.quarry.state().isFlying));
  assert.ok((await viewOf(page)).camera.ortho > 0);
  await page.keyboard.press('o');
  assert.ok((await viewOf(page)).camera.fov > 0);
});

test('the browser keeps its keys', async () => {
  const before = await rest();
  await page.evaluate(() => {
    window.taken_ = [];
    addEventListener('keydown', event => { if (event.ctrlKey && event.key !== 'Control') window.taken_.push([event.key, event.defaultPrevented]); event.preventDefault(); });
  });
  for (const key of ['f', 'r', 'l', 'p', 'g', '1', '0', '+', '-']) await page.keyboard.press(`Control+${key}`);
  for (const [key, taken] of await page.evaluate(() => window.taken_)) assert.ok(!taken, `Ctrl ${key}`);
  assert.deepEqual((await viewOf(page)).camera, before);
  await page.reload();
  await untilExact(page);
});

test('held keys are released when the window loses the focus', async () => {
  await page.keyboard.press('g');
  await page.keyboard.down('w');
  await pause(300);
  await page.evaluate(() => dispatchEvent(new Event('blur')));
  const stopped = await rest();
  await pause(400);
  assert.deepEqual((await viewOf(page)).camera, stopped);
  await page.keyboard.up('w');
  await page.keyboard.press('g');
});

test('wheel, context menu and history', async () => {
  const turn = (deltaX, deltaY, more = {}) => page.evaluate(([x, y, rest]) => {
    const event = new WheelEvent('wheel', { deltaX: x, deltaY: y, clientX: 320, clientY: 240, bubbles: true, cancelable: true, ...rest });
    document.getElementById('stage').dispatchEvent(event);
    return event.defaultPrevented;
  }, [deltaX, deltaY, more]);
  const far = distance(await rest());
  await turn(0, -100);
  const near = await rest();
  assert.ok(distance(near) < far);
  await turn(50, 0);
  await pause(300);
  assert.ok(Math.abs(distance(await rest()) - distance(near)) < 1e-6 * far);
  assert.ok(await turn(0, -10, { ctrlKey: true }), 'the page is not zoomed');
  await turn(0, -1e9);
  assert.ok(distance(await rest()) > 0.1 * distance(near));
  const lines = await page.evaluate(() => history.length), eye = await eyeOf(page);
  for (let i = 0; i < 6; ++i) {
    await page.mouse.move(300, 240);
    await page.mouse.down();
    await page.mouse.move(340, 250, { steps: 3 });
    await page.mouse.up();
  }
  await page.waitForFunction(() => location.hash.includes('eye='), null, { timeout: 5000 });
  assert.equal(await page.evaluate(() => history.length), lines);
  assert.ok(apart(eye, await eyeOf(page)) > 0);
  const menu = await page.evaluate(() => {
    const event = new MouseEvent('contextmenu', { bubbles: true, cancelable: true });
    document.getElementById('stage').dispatchEvent(event);
    return event.defaultPrevented;
  });
  assert.ok(menu);
  const before = await rest();
  await page.mouse.move(300, 240);
  await page.mouse.down({ button: 'right' });
  await page.mouse.move(350, 260, { steps: 4 });
  await page.mouse.up({ button: 'right' });
  const panned = await rest();
  assert.ok(apart(direction(before), direction(panned)) < 1e-6 && apart(before.eye, panned.eye) > 0);
});

test('two fingers zoom the view, and not the page itself', async () => {
  const phone = await open(cluster.url, { viewport: { width: 390, height: 700 }, deviceScaleFactor: 2, hasTouch: true, isMobile: true });
  const before = await rest(phone);
  assert.match(await phone.locator('#hint').innerText(), /finger/);
  await shoot(phone, 'touch');
  const session = await phone.context().newCDPSession(phone);
  const touch = (type, ...xs) => session.send('Input.dispatchTouchEvent', { type, touchPoints: xs.map((x, id) => ({ x, y: 350, id })) });
  await touch('touchStart', 170, 220);
  for (let i = 1; i <= 10; ++i) {
    await touch('touchMove', 170 - 10 * i, 220 + 10 * i);
    await pause(20);
  }
  await touch('touchEnd');
  assert.ok(distance(await rest(phone)) < 0.8 * distance(before) || apart((await viewOf(phone)).camera.eye, before.eye) > 0.2 * distance(before));
  assert.equal(await phone.evaluate(() => visualViewport.scale), 1);
  await phone.context().close();
});

test('tabs have views of their own, and a high-density screen gets all its pixels', async () => {
  const other = await visit(page.context(), cluster.url);
  const theirs = await rest(other), before = await rest();
  await page.mouse.move(300, 240);
  await page.mouse.down();
  await page.mouse.move(400, 260, { steps: 4 });
  await page.mouse.up();
  assert.notDeepEqual(await rest(), before);
  assert.deepEqual(await rest(other), theirs);
  await other.close();
  const sharp = await open(cluster.url, { deviceScaleFactor: 2 });
  await untilExact(sharp);
  await shoot(sharp, 'sharp');
  assert.deepEqual((await viewOf(sharp)).size, [2 * SIZE.width, 2 * SIZE.height]);
  await sharp.context().close();
});

test('a chosen background, and the plain one again', async () => {
  const seen = await open(cluster.url);
  await untilExact(seen);
  await seen.getByRole('button', { name: 'Settings' }).click();
  assert.equal((await viewOf(seen)).background, undefined);
  assert.ok(await seen.locator('#background-automatic').isChecked());
  await seen.locator('#background').fill('#204060');
  await seen.waitForFunction(() => window.quarry.view().background !== undefined);
  await untilExact(seen);
  assert.ok(!await seen.locator('#background-automatic').isChecked());
  await shoot(seen, 'background');
  await seen.locator('#background-automatic').check();
  await untilExact(seen);
  assert.equal((await viewOf(seen)).background, undefined);
  await seen.context().close();
});

test('mode path names its lights, and the tone curve is chosen', async () => {
  const seen = await open(cluster.url);
  await untilExact(seen);
  await seen.getByRole('button', { name: 'Settings' }).click();
  await seen.evaluate(next => window.quarry.setView(next), { ...await viewOf(seen), mode: 'path', spp: 2 });
  const film = (await exactOf(seen)).png;
  assert.equal((await viewOf(seen)).tonemap, undefined);
  await seen.locator('#tone').selectOption('clip');
  await seen.waitForFunction(() => window.quarry.view().tonemap === 'clip');
  await untilExact(seen);
  const { view, png } = await exactOf(seen);
  assert.ok(!png.equals(film), 'bright values are cut off now');
  assert.ok(png.equals(cluster.render(view)), 'the exact frame is the file that quarry render writes');
  await seen.locator('#status').click();
  await seen.waitForFunction(() => /Light\s*sun, sky/.test(document.getElementById('details').innerText));
  await shoot(seen, 'path');
  await seen.locator('#tone').selectOption('');
  await seen.waitForFunction(() => window.quarry.view().tonemap === undefined);
  await seen.context().close();
});

test('a page of another site cannot frame the view', async () => {
  const portal = http.createServer((_, answer) => {
    answer.setHeader('Content-Type', 'text/html');
    answer.end(`<h1>portal</h1><iframe src="${cluster.url}" width="600" height="400"></iframe>`);
  });
  await new Promise(resolve => portal.listen(0, '127.0.0.1', resolve));
  const framing = await open(`http://127.0.0.1:${portal.address().port}/`);
  await pause(1000);
  const [, frame] = framing.frames();
  assert.equal(await frame.evaluate(() => document.getElementById('stage')).catch(() => null), null);
  await shoot(framing, 'framed');
  await framing.context().close();
  portal.close();
});

test('a silent connection is opened again, and shows the newest view', async () => {
  cluster.master.kill('SIGSTOP');
  const before = await viewOf(page);
  await page.evaluate(view => window.quarry.setView(view), { ...before, camera: { ...before.camera, eye: before.camera.eye.map(x => 1.1 * x) } });
  await page.waitForFunction(() => window.quarry.state().connection !== 'open', null, { timeout: 30000 });
  cluster.master.kill('SIGCONT');
  await page.waitForFunction(() => window.quarry.state().connection === 'open', null, { timeout: 30000 });
  await untilExact(page);
  assert.deepEqual(await eyeOf(page), before.camera.eye.map(x => 1.1 * x));
});

test('a starved cluster shows a coarse whole picture, and continues', async () => {
  await page.evaluate(() => window.quarry.setView({}));
  await untilExact(page);
  const [worker] = cluster.workers;
  let isStarved = true;
  const starve = (async () => {  // a tenth of the time at most
    while (isStarved) {
      worker.kill('SIGSTOP');
      await pause(100);
      worker.kill('SIGCONT');
      await pause(5);
    }
  })();
  await page.evaluate(() => {
    window.headers_ = new Map();
    const look = () => {
      const { header } = window.quarry.state();
      window.headers_.set(header.frame, header);
      window.look_ = requestAnimationFrame(look);
    };
    look();
  });
  const drawn = await drawnBy(page), began = Date.now();
  await page.mouse.move(200, 240);
  await page.mouse.down();
  for (let i = 1; i <= 120; ++i) {
    await page.mouse.move(200 + 2 * i, 240);
    await pause(25);
  }
  const seconds = (Date.now() - began) / 1000, frames = await drawnBy(page) - drawn;
  await shoot(page, 'starved');
  await page.mouse.up();
  isStarved = false;
  await starve;
  assert.ok(frames / seconds >= 2, `${frames} frames in ${seconds} s`);
  for (const header of await page.evaluate(() => { cancelAnimationFrame(window.look_); return [...window.headers_.values()]; })) {
    const [width, height] = header.size;
    const points = Math.ceil(width / header.step) * Math.ceil(height / header.step);
    assert.ok(Math.round(header.traced * width * height) + header.waiting >= points, JSON.stringify(header));
  }
  await untilExact(page);
});

test('no page has raised an error', () => assert.deepEqual(errors, []));
