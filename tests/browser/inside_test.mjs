// Looking inside the model in a real browser: search, hide, section, measure, keep, save, reload. Pictures of the page are the files of
// `quarry render --view`, byte for byte.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import { after, before, test } from 'node:test';
import { Cluster } from './cluster.mjs';
import { errors, exactOf, launch, open as openIn, pause, shoot, untilExact, viewOf } from './viewing.mjs';

const BOLTS = 3000;
const cluster = new Cluster();
let browser, page;
const open = (url, options) => openIn(browser, url, options);
const state = () => page.evaluate(() => window.quarry.state());
const toast = () => page.locator('#toast').innerText();

/** The lines of an OBJ with boxes as parts: a vessel with a valve inside, and many bolts beside it. */
function model() {
  const lines = [], faces = ['1 3 4 2', '5 6 8 7', '1 2 6 5', '3 7 8 4', '1 5 7 3', '2 4 8 6'];
  let vertices = 0;
  const box = (object, group, lower, upper) => {
    lines.push(`o ${object}`, ...(group ? [`g ${group}`] : []));
    for (let corner = 0; corner < 8; ++corner) lines.push(`v ${[0, 1, 2].map(axis => (corner >> axis & 1 ? upper : lower)[axis]).join(' ')}`);
    for (const face of faces) lines.push(`f ${face.split(' ').map(n => Number(n) + vertices).join(' ')}`);
    vertices += 8;
  };
  box('floor', '', [-1, -1, -1], [11, 9, -0.5]);
  for (const [group, lower, upper] of [['west wall', [0, 0, 0], [0.5, 8, 6]], ['east wall', [7.5, 0, 0], [8, 8, 6]], ['south wall', [0.5, 0, 0], [7.5, 0.5, 6]],
    ['north wall', [0.5, 7.5, 0], [7.5, 8, 6]], ['lid', [0, 0, 6], [8, 8, 6.5]], ['valve', [3, 3, 1], [5, 5, 3]]]) box('vessel', group, lower, upper);
  for (let i = 0; i < BOLTS; ++i) {
    const x = 8.5 + (i % 20) * 0.12, y = -0.9 + Math.floor(i / 20) * 0.065;
    box('bolts', `bolt ${i}`, [x, y, 0], [x + 0.1, y + 0.05, 0.2]);
  }
  return lines.join('\n') + '\n';
}

/** The page's picture must be the batch job's file. */
async function checkExact() {
  const { view, png } = await exactOf(page);
  assert.ok(png.equals(cluster.render(view)), `the page shows the file of ${JSON.stringify(view)}`);
  return view;
}

/** Looks straight down at the lid, so that places in the picture are known: 50 pixels for a unit around (4, 4). `hide`: paths. */
async function lookDown(hide = []) {
  await page.evaluate(list => window.quarry.setView({ hide: list, mode: 'raycast', spp: 1, camera: { eye: [4, 4, 30], at: [4, 4, 0], up: [0, 1, 0], ortho: 16 } }), hide);
  await untilExact(page);
}
const at = (x, y) => [700 + 50 * (x - 4), 400 - 50 * (y - 4)];

async function downloadOf(button) {
  const [saved] = await Promise.all([page.waitForEvent('download', { timeout: 60000 }), page.click(button)]);
  return { name: saved.suggestedFilename(), text: fs.readFileSync(await saved.path(), 'utf8') };
}

/** Opens a file in the page. */
const give = (name, text) => page.setInputFiles('#kept-file', { name, mimeType: 'application/json', buffer: Buffer.from(text) });

before(async () => {
  await cluster.beginWith('vessel.obj', model());
  for (let i = 0; i < 2; ++i) cluster.addWorker();
  browser = await launch();
  page = await open(cluster.url, { viewport: { width: 1400, height: 800 }, permissions: ['clipboard-read', 'clipboard-write'] });
  await untilExact(page);
});

after(async () => {
  await browser?.close();
  await cluster.end();
});

test('parts are served in pages, and only to those who may see the model', async () => {
  const ask = query => page.evaluate(async text => {
    const answer = await fetch(`parts?${text}`);
    return { status: answer.status, body: answer.ok ? await answer.json() : await answer.text() };
  }, query);
  const { body: roots } = await ask('parent=none&count=10');
  assert.deepEqual(roots.parts.map(({ name }) => name), ['floor', 'vessel', 'bolts']);
  const [, vessel, bolts] = roots.parts;
  assert.deepEqual([vessel.children, vessel.triangles, vessel.box, vessel.parent], [6, 72, [[0, 0, 0], [8, 8, 6.5]], null]);
  const { body: some } = await ask(`parent=${bolts.id}&from=${BOLTS - 2}&count=100`);
  assert.deepEqual([some.total, some.parts.map(({ path }) => path)], [BOLTS, [`bolts/bolt ${BOLTS - 2}`, `bolts/bolt ${BOLTS - 1}`]]);
  assert.ok(some.parts[0].closed);
  const { body: one } = await ask(`id=${some.parts[1].id}`);
  assert.deepEqual([one.ancestors, one.places], [[bolts.id], [2, BOLTS - 1]]);
  const { body: found } = await ask('find=BOLT%2029&count=3');
  assert.deepEqual([found.total, found.parts.length], [111, 3]);
  for (const query of ['', 'parent=-1', 'parent=none&id=0', 'id=99999', 'find=', 'parent=none&from=x', 'parent=none&more=1', 'id']) {
    const { status, body } = await ask(query);
    assert.equal(status, 400, query);
    assert.match(body, /^.{20,}\n$/, query);
  }
  const stranger = await fetch(`http://127.0.0.1:${cluster.httpPort}/parts?parent=none`);
  assert.equal(stranger.status, 403);
});

test('a search finds parts, and a click in the list chooses one', async () => {
  await page.click('#tool-parts');
  await page.fill('#parts-search', 'valve');
  await page.waitForFunction(() => document.getElementById('parts-count').textContent === '1 part');
  await page.click('#tree .row');
  assert.deepEqual((await state()).chosen, ['vessel/valve']);
  assert.match(await page.locator('#pick').innerText(), /vessel\/valve[^]*Triangles\s*12[^]*2 × 2 × 2/);
  assert.ok(await page.evaluate(() => document.querySelector('#marks .chosen .over').getAttribute('d').length > 50));
  await shoot(page, 'inside-search');
});

test('the tree has rows for what is in sight only, and obeys the keyboard', async () => {
  await page.fill('#parts-search', '');
  await page.waitForFunction(() => document.querySelectorAll('#tree .row[aria-label]').length >= 3);
  await page.focus('#parts-search');
  await page.keyboard.press('ArrowDown');
  await page.keyboard.press('Home');
  for (const key of ['ArrowDown', 'ArrowDown']) await page.keyboard.press(key);
  while (!/^bolts/.test(await page.evaluate(() => document.activeElement.getAttribute('aria-label')))) await page.keyboard.press('ArrowDown');
  assert.equal(await page.evaluate(() => document.activeElement.getAttribute('aria-expanded')), 'false');
  await page.keyboard.press('ArrowRight');
  await page.waitForFunction(() => document.activeElement.getAttribute('aria-expanded') === 'true');
  await page.locator('#tree .row[aria-label^="bolt 0,"]').waitFor();
  await page.keyboard.press('End');
  await page.waitForFunction(last => document.activeElement.getAttribute('aria-label')?.startsWith(last), `bolt ${BOLTS - 1}`);
  const row = await page.evaluate(() => ['aria-level', 'aria-posinset', 'aria-setsize'].map(name => document.activeElement.getAttribute(name)));
  assert.deepEqual(row, ['2', String(BOLTS), String(BOLTS)]);
  assert.ok(await page.locator('#tree .row').count() < 60);
  await page.keyboard.press('Enter');
  await page.keyboard.press('Shift+ArrowUp');
  await page.keyboard.press('Shift+ArrowUp');
  await page.waitForFunction(() => window.quarry.state().chosen.length === 3);
  await shoot(page, 'inside-tree');
  await page.keyboard.press('ArrowLeft');
  assert.match(await page.evaluate(() => document.activeElement.getAttribute('aria-label')), /^bolts/);
});

test('a click in the picture chooses a part and shows it in the tree; H hides it, Ctrl+Z takes it back', async () => {
  await lookDown();
  await page.mouse.click(...at(4, 6));
  await page.waitForFunction(() => window.quarry.state().chosen[0] === 'vessel/lid');
  await page.waitForFunction(() => document.querySelector('#tree .row[aria-selected=true]')?.getAttribute('aria-label').startsWith('lid'));
  await page.keyboard.press('h');
  assert.deepEqual((await checkExact()).hide, ['vessel/lid']);
  await page.mouse.click(...at(4, 4));
  await page.waitForFunction(() => window.quarry.state().chosen[0] === 'vessel/valve');
  await shoot(page, 'inside-hidden');
  await page.keyboard.press('Control+z');
  assert.equal((await checkExact()).hide, undefined);
  await page.keyboard.press('Control+Shift+z');
  assert.deepEqual((await checkExact()).hide, ['vessel/lid']);
  await page.keyboard.press('Shift+H');
  assert.equal((await checkExact()).hide, undefined);
});

test('only the chosen parts, colours, dimmed others; the frame key shows what is left', async () => {
  await page.mouse.click(...at(0.2, 4));
  for (const key of ['Control', 'Shift']) {
    await page.keyboard.down(key);
    await page.mouse.click(...(key === 'Control' ? at(10, 8.9) : at(9.05, -0.1)));
    await page.keyboard.up(key);
  }
  await page.waitForFunction(() => window.quarry.state().chosen.length === 3);
  await page.keyboard.press('Escape');
  await page.fill('#parts-search', 'valve');
  await page.waitForFunction(() => document.getElementById('parts-count').textContent === '1 part');
  await page.click('#tree .row', { button: 'right' });
  await page.getByRole('menuitem', { name: 'Colour: red' }).click();
  await page.click('#tree .row');
  await page.click('#parts-dim');
  const dimmed = await checkExact();
  assert.equal(dimmed.colors.length, 3);
  await page.click('#parts-dim');
  await page.keyboard.press('i');
  const only = await checkExact();
  assert.deepEqual([only.only, only.colors.length], [['vessel/valve'], 1]);
  await page.focus('#stage');
  await page.keyboard.press('f');
  await page.waitForFunction(() => window.quarry.view().camera.ortho < 5, null, { timeout: 5000 });
  await checkExact();
  await shoot(page, 'inside-only');
  await page.keyboard.press('Shift+H');
});

test('a section is typed or dragged, and its caps are drawn', async () => {
  await lookDown();
  await page.focus('#stage');
  await page.keyboard.press('x');
  await page.fill('#section-box input[aria-label="z to"]', '2');
  await page.press('#section-box input[aria-label="z to"]', 'Enter');
  assert.equal((await checkExact()).section.box[1][2], 2);
  await shoot(page, 'inside-section');
  await page.mouse.click(...at(0.25, 4));  // the wall is solid where it is cut
  await page.waitForFunction(() => /west wall[^]*Position\s*0\.2\d*, (3\.9|4)\d*, 2\s/.test(document.getElementById('pick').innerText));
  await page.keyboard.press('Escape');
  const handle = await page.locator('#marks .handle.x1').boundingBox();
  await page.mouse.move(handle.x + 9, handle.y + 9);
  await page.mouse.down();
  await page.mouse.move(...at(4, 4), { steps: 6 });
  await page.mouse.up();
  const { section } = await checkExact();
  assert.ok(Math.abs(section.box[1][0] - 4) < 0.1, `the side follows the cursor: ${section.box[1]}`);
  await page.mouse.click(...at(2, 4), { button: 'right' });
  await page.getByRole('menuitem', { name: 'Section at this face' }).click();
  assert.equal((await checkExact()).section.planes.length, 1);
  await page.click('#section-remove');
  assert.equal((await checkExact()).section, undefined);
  await page.click('#section-close');
});

test('measurements take corners exactly, and follow a normal to the next surface', async () => {
  await lookDown();
  await page.keyboard.press('m');
  await page.mouse.click(...at(0.06, 0.06));
  await pause(300);
  await page.mouse.click(...at(7.94, 7.94));
  await page.waitForFunction(() => window.quarry.state().measured.length === 1);
  assert.equal((await state()).measured[0], 'Distance: 11.3137\u00a0units (x 8, y 8, z 0)');
  await page.check('#measure-kinds input[value=angle]');
  for (const [x, y] of [[0.06, 0.06], [7.94, 0.06], [7.94, 7.94]]) {
    await page.mouse.click(...at(x, y));
    await pause(300);
  }
  await page.waitForFunction(() => window.quarry.state().measured.length === 2);
  assert.equal((await state()).measured[1], 'Angle: 90.00°');
  // From the floor between the walls to the lid's lower side.
  await page.evaluate(() => window.quarry.setView({ ...window.quarry.view(), hide: ['vessel/lid'] }));
  await untilExact(page);
  await page.check('#measure-kinds input[value=normal]');
  await page.mouse.click(...at(2, 4));
  await page.waitForFunction(() => /no other surface/.test(document.getElementById('toast').innerText));
  await page.evaluate(() => window.quarry.setView({ ...window.quarry.view(), hide: ['vessel/west wall'],
    camera: { eye: [-30, 4, 7.5], at: [1.5, 4, -0.5], up: [0, 0, 1], ortho: 16 } }));
  await untilExact(page);
  await page.mouse.click(700, 400);
  await page.waitForFunction(() => window.quarry.state().measured.length === 3);
  assert.equal((await state()).measured[2], 'From a face: 6.5\u00a0units (x 0, y 0, z 6.5)');
  await shoot(page, 'inside-measured');
  await page.keyboard.press('m');
  await lookDown(['vessel/lid']);
});

test('views and notes are kept, saved as a file, and opened again', async () => {
  await page.keyboard.press('k');
  await page.fill('#kept-name', 'the valve');
  await page.press('#kept-name', 'Enter');
  await page.mouse.click(...at(4, 4));
  await page.locator('#pick').waitFor({ state: 'visible' });
  await page.fill('#note-text', 'leaks here');
  await page.press('#note-text', 'Enter');
  await page.keyboard.press('Escape');
  await page.focus('#stage');
  await page.keyboard.press('1');
  await pause(400);
  await untilExact(page);
  await page.click('#kept-add');
  await shoot(page, 'inside-kept');
  const saved = await downloadOf('#kept-save');
  const kept = JSON.parse(saved.text);
  assert.deepEqual(kept.views.map(({ name }) => name), ['the valve', 'View 2']);
  assert.deepEqual(kept.views[0].view.hide, ['vessel/lid']);
  assert.deepEqual([kept.notes[0].text, kept.notes[0].point[2]], ['leaks here', 3]);
  while (await page.locator('#kept-views li').count()) await page.locator('#kept-views li button').last().click();
  await give(saved.name, saved.text);
  await page.waitForFunction(() => document.querySelectorAll('#kept-views li').length === 2);
  await page.locator('#kept-views .go').first().click();
  assert.deepEqual((await checkExact()).hide, ['vessel/lid']);
});

test('a path through kept views is played, and rendered by --camera-path', async () => {
  await page.fill('#path-seconds', '0.1');
  const saved = await downloadOf('#path-save');
  fs.writeFileSync(cluster.file('walk.json'), saved.text);
  cluster.run('quarry', 'render', cluster.store, '-o', cluster.file('walk.png'), '--camera-path', cluster.file('walk.json'), '--frames', '0', '--size', '1400x800', '--quiet', '--force');
  await page.locator('#kept-views .go').first().click();
  const { png } = await exactOf(page);
  assert.ok(png.equals(fs.readFileSync(cluster.file('walk.0000.png'))), 'the first frame is the first view');
  await page.fill('#path-seconds', '1');
  await page.click('#path-play');
  assert.equal(await page.locator('#path-play').innerText(), 'Stop');
  await page.waitForFunction(() => document.getElementById('path-play').innerText === 'Play', null, { timeout: 10000 });
  const last = JSON.parse(saved.text).frames.at(-1);
  assert.deepEqual((await viewOf(page)).camera.eye, last.eye);
});

test('files that hold no view get a sentence, and the view stays', async () => {
  const before = await checkExact();
  for (const [name, text] of [['a.json', '{'], ['b.json', '[]'], ['c.json', '{"camera":{"eye":[0,0,0]}}'], ['d.json', '{"frames":[]}'],
    ['e.json', '{"format":"quarry kept views","version":1,"views":[{}],"notes":[]}'], ['f.json', JSON.stringify({ ...before, section: { box: [[0, 0, 0], [0, 1, 1]] } })],
    ['g.json', JSON.stringify({ ...before, only: [] })]]) {
    await page.evaluate(() => { document.getElementById('toast').textContent = ''; });
    await give(name, text);
    await page.waitForFunction(() => document.getElementById('toast').textContent.length > 15, null, { timeout: 5000 });
    assert.deepEqual((await viewOf(page)).camera, before.camera, name);
  }
  for (const change of [{ hide: ['vessel/vlave'] }, { unknown: 1 }]) {
    await page.evaluate(() => { document.getElementById('toast').textContent = ''; });
    await give('h.json', JSON.stringify({ ...before, ...change }));
    await page.waitForFunction(() => document.getElementById('toast').textContent.length > 15, null, { timeout: 5000 });
    if (change.hide) assert.match(await toast(), /the nearest is `vessel\/valve`/);
    await untilExact(page);
    assert.deepEqual(await viewOf(page), before);
  }
});

test('a reload shows the same; a long view is kept under a short link', async () => {
  const before = await checkExact();
  await page.waitForFunction(() => /hide=/.test(location.hash));
  await page.reload();
  assert.deepEqual((await checkExact()).hide, before.hide);
  await page.evaluate(() => window.quarry.setView({ ...window.quarry.view(), hide: Array.from({ length: 300 }, (_, i) => `bolts/bolt ${i}`) }));
  await page.waitForFunction(() => /^#kept=/.test(location.hash));
  const long = await checkExact();
  await page.keyboard.press('p');
  await page.click('#copy-link');
  await page.waitForFunction(() => /in this browser only/.test(document.getElementById('toast').innerText));
  await page.goto('about:blank');
  await page.goto(`${cluster.url.split('?')[0]}`);
  await page.evaluate(async () => { location.hash = new URL(await navigator.clipboard.readText()).hash; });
  assert.deepEqual((await checkExact()).hide, long.hide);
});

test('a restarted master makes the selection again', async () => {
  const before = await checkExact();
  const gone = new Promise(resolve => cluster.master.once('exit', resolve));
  cluster.master.kill('SIGKILL');
  await gone;
  await page.waitForFunction(() => window.quarry.state().connection !== 'open', null, { timeout: 20000 });
  await cluster.startMaster();
  await page.waitForFunction(() => window.quarry.state().connection === 'open', null, { timeout: 30000 });
  assert.deepEqual((await checkExact()).hide, before.hide);
});

test('a long press opens the menu on a phone', async () => {
  const phone = await open(cluster.url, { viewport: { width: 390, height: 800 }, deviceScaleFactor: 2, hasTouch: true, isMobile: true });
  await untilExact(phone);
  const session = await phone.context().newCDPSession(phone);
  await session.send('Input.dispatchTouchEvent', { type: 'touchStart', touchPoints: [{ x: 195, y: 420, id: 0 }] });
  await phone.locator('#part-menu').waitFor({ state: 'visible', timeout: 5000 });
  await session.send('Input.dispatchTouchEvent', { type: 'touchEnd', touchPoints: [] });
  await shoot(phone, 'inside-phone-menu');
  await phone.getByRole('menuitem', { name: 'Hide' }).tap();
  await phone.waitForFunction(() => window.quarry.view().hide?.length === 1);
  await untilExact(phone);
  await phone.tap('#tool-parts');
  await pause(500);
  await shoot(phone, 'inside-phone');
  await phone.context().close();
});

/** A glTF of two triangles side by side, which shine. The nodes have names, and one has `extras`. */
function tagged() {
  const data = Buffer.from(new Float32Array([0, 0, 0, 1, 0, 0, 0, 0, 1]).buffer);
  return JSON.stringify({
    asset: { version: '2.0' }, buffers: [{ uri: `data:application/octet-stream;base64,${data.toString('base64')}`, byteLength: data.length }],
    bufferViews: [{ buffer: 0, byteLength: data.length }], accessors: [{ bufferView: 0, componentType: 5126, count: 3, type: 'VEC3', min: [0, 0, 0], max: [1, 0, 1] }],
    materials: [{ emissiveFactor: [0.5, 0.4, 0.3] }], meshes: [{ primitives: [{ attributes: { POSITION: 0 }, material: 0 }] }], scenes: [{ nodes: [0, 1] }],
    nodes: [{ name: 'plain', mesh: 0 }, { name: 'valve', mesh: 0, translation: [2, 0, 0], extras: { tag: 'V-101', 'mass <kg>': 2.5, checked: { by: 'B' } } }],
  });
}

test('the card of a part shows what the model states of it', async () => {
  const own = new Cluster();
  try {
    await own.beginWith('tagged.gltf', tagged());
    own.addWorker();
    const other = await open(own.url, { viewport: { width: 1000, height: 600 } });
    await untilExact(other);
    await other.click('#tool-parts');
    const row = name => other.locator(`#tree .row[aria-label^="${name}"]`);
    await row('valve').click();
    await other.waitForFunction(() => /V-101/.test(document.getElementById('pick').innerText));
    assert.match(await other.locator('#pick').innerText(), /checked\s*{"by":"B"}[^]*mass <kg>\s*2\.5[^]*tag\s*V-101/);
    await shoot(other, 'inside-attributes');
    for (const change of [{ mode: 'path', spp: 2 }, { mode: 'path', spp: 2, lights: [{ type: 'point', position: [1, -2, 3], radiance: [9, 9, 9] }] }]) {
      await other.evaluate(view => window.quarry.setView(view), change);
      const { view, png } = await exactOf(other);
      assert.ok(png.equals(own.render(view)), `the page shows the file of ${JSON.stringify(view)}`);
      assert.equal(view.lights.length, change.lights ? 1 : 0);
    }
    await shoot(other, 'path-shining');
    await row('plain').click();
    await other.waitForFunction(() => /plain/.test(document.getElementById('pick-title').innerText));
    assert.doesNotMatch(await other.locator('#pick').innerText(), /V-101/);
    await other.context().close();
  } finally {
    await own.end();
  }
});

test('no page has raised an error', () => assert.deepEqual(errors, []));
