// A cluster of real processes for the browser tests: a master with its live view, workers, and nginx before it.
import { spawn, spawnSync } from 'node:child_process';
import fs from 'node:fs';
import net from 'node:net';
import os from 'node:os';
import path from 'node:path';
import readline from 'node:readline';

export const BIN = process.env.QUARRY_BIN ?? path.resolve(path.dirname(new URL(import.meta.url).pathname), '../../build/release/bin');

/** A port that nobody listens at. */
export function freePort() {
  return new Promise((resolve, reject) => {
    const server = net.createServer();
    server.once('error', reject);
    server.listen(0, '127.0.0.1', () => {
      const { port } = server.address();
      server.close(() => resolve(port));
    });
  });
}

export class Cluster {
  constructor() {
    this.folder = fs.mkdtempSync(path.join(os.tmpdir(), 'quarry-browser-'));
    this.children = new Set();
    this.workers = [];
    this.logs = '';
    this.environments = [];  // stores that the master is started with
  }

  file(name) { return path.join(this.folder, name); }

  /** Runs a program to its end; throws with its standard error if it fails. */
  run(program, ...args) {
    const ended = spawnSync(path.join(BIN, program), args, { encoding: 'utf8' });
    if (ended.status !== 0) throw new Error(`${program} ${args.join(' ')}: ${ended.stderr}`);
    return ended.stdout;
  }

  start(command, ...args) {
    const child = spawn(command, args, { stdio: ['ignore', 'pipe', 'pipe'] });
    this.children.add(child);
    child.once('exit', () => this.children.delete(child));
    child.stderr.on('data', text => { this.logs += text; });
    return child;
  }

  /** Makes the scene and starts a master at ports that stay the same when it is started again. `name`: of the store. */
  async begin(triangles, name = 'plant') {
    this.run('quarry-scene', 'plant', '--triangles', String(triangles), '-o', this.file('plant.ply'));
    await this.serve('plant.ply', name);
  }

  /** The same with a model whose text is given. */
  async beginWith(file, text) {
    fs.writeFileSync(this.file(file), text);
    await this.serve(file, file.replace(/\..*/, ''));
  }

  async serve(model, name) {
    this.store = this.file(`${name}.quarry`);
    this.run('quarry-preprocess', this.file(model), '-o', this.store, '--quiet');
    this.token = 'a-token-of-the-browser-tests-0123456789';
    fs.writeFileSync(this.file('token'), this.token, { mode: 0o600 });
    this.httpPort = await freePort();
    this.masterPort = await freePort();
    this.nginxPort = await freePort();
    await this.startMaster();
  }

  async startMaster() {
    this.master = this.start(path.join(BIN, 'quarry-master'), this.store, '--listen', `127.0.0.1:${this.masterPort}`,
      '--http', `127.0.0.1:${this.httpPort}`, '--view-token-file', this.file('token'),
      '--viewer-url', `https://localhost:${this.nginxPort}/a/b/`, ...this.environments.flatMap(store => ['--environment', store]));
    for await (const line of readline.createInterface({ input: this.master.stdout }))
      if (line.startsWith('listening')) break;
    this.url = `http://127.0.0.1:${this.httpPort}/?token=${this.token}`;
  }

  /** Makes the store of a sky that is bright on one side, for a master that starts later. */
  addEnvironment(name) {
    const width = 64, pixels = Buffer.alloc(width * width / 2 * 4);
    for (let i = 0; i < pixels.length; i += 4) pixels.set([200, 150, 100, 128 + (i / 4 % width < width / 4 ? 3 : 0)], i);
    fs.writeFileSync(this.file(`${name}.hdr`), Buffer.concat([Buffer.from(`#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y ${width / 2} +X ${width}\n`), pixels]));
    this.environments.push(this.file(`${name}.quarry`));
    this.run('quarry-preprocess', this.file(`${name}.hdr`), '-o', this.environments.at(-1), '--quiet');
  }

  addWorker() {
    const worker = this.start(path.join(BIN, 'quarry-worker'), '--master', `127.0.0.1:${this.masterPort}`, '--threads', '1',
      '--cache', '128M', '--name', `w${this.workers.length + 1}`);
    this.workers.push(worker);
    return worker;
  }

  /** Changes bytes all over the middle of the scene's file: of many blocks. */
  damage() {
    const file = fs.openSync(this.store, 'r+');
    const { size } = fs.fstatSync(file);
    const byte = Buffer.alloc(1);
    for (let at = Math.floor(size / 4); at < size * 3 / 4; at += 4096) {
      fs.readSync(file, byte, 0, 1, at);
      fs.writeSync(file, Buffer.from([byte[0] ^ 0x55]), 0, 1, at);
    }
    fs.closeSync(file);
  }

  /** A picture of the cluster's, made of a view as a batch job. */
  render(view) {
    fs.writeFileSync(this.file('view.json'), JSON.stringify(view));
    this.run('quarry', 'render', '-o', this.file('view.png'), '--view', this.file('view.json'), '--force', '--quiet', '--master',
      `127.0.0.1:${this.masterPort}`);
    return fs.readFileSync(this.file('view.png'));
  }

  /** nginx with a certificate of its own, the live view at /a/b/, at /whole/ with its prefix, and at /deaf/ without WebSockets. */
  async startNginx() {
    const made = spawnSync('openssl', ['req', '-x509', '-newkey', 'rsa:2048', '-nodes', '-days', '2', '-subj', '/CN=localhost', '-keyout',
      this.file('key.pem'), '-out', this.file('cert.pem')]);
    if (made.status !== 0) throw new Error(`openssl: ${made.stderr}`);
    fs.writeFileSync(this.file('nginx.conf'), `daemon off; pid ${this.file('nginx.pid')}; error_log stderr;
      events {}
      http { access_log off; client_body_temp_path ${this.folder}; proxy_temp_path ${this.folder}; fastcgi_temp_path ${this.folder};
        uwsgi_temp_path ${this.folder}; scgi_temp_path ${this.folder};
        server { listen 127.0.0.1:${this.nginxPort} ssl; ssl_certificate ${this.file('cert.pem')}; ssl_certificate_key ${this.file('key.pem')};
          location /a/b/ { proxy_pass http://127.0.0.1:${this.httpPort}/; proxy_http_version 1.1; proxy_set_header Host $http_host;
            proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection "upgrade"; }
          location /whole/ { proxy_pass http://127.0.0.1:${this.httpPort}; proxy_http_version 1.1; proxy_set_header Host $http_host;
            proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection "upgrade"; }
          location /deaf/ { proxy_pass http://127.0.0.1:${this.httpPort}/; proxy_set_header Host $http_host; } } }`);
    this.start('nginx', '-p', this.folder, '-c', this.file('nginx.conf'));
    for (let tries = 0; tries < 100; ++tries) {
      const open = await new Promise(resolve => {
        const socket = net.connect(this.nginxPort, '127.0.0.1', () => { socket.destroy(); resolve(true); });
        socket.once('error', () => resolve(false));
      });
      if (open) return;
      await new Promise(resolve => setTimeout(resolve, 50));
    }
    throw new Error(`nginx does not listen: ${this.logs}`);
  }

  async end() {
    const ended = [...this.children].map(child => new Promise(resolve => child.once('exit', resolve)));
    for (const child of this.children) child.kill('SIGTERM');
    await Promise.all(ended);
    fs.rmSync(this.folder, { recursive: true, force: true });
  }
}
