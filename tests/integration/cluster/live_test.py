"""The live view without a browser: exactness, limits, a crowd of viewers, jobs beside it, the page of a model that is being made."""
import contextlib
import http.client
import json
import math
import os
import pathlib
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.parse

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, PATIENCE, TIMEOUT_S, Case, end, main
from tests.support.cluster.live_client import Closed, LiveClient
from tests.support.cluster.starved import Starved, is_whole, why_not_starved


def resident(pid):
    """Bytes that a process has in memory now."""
    return int(re.search(r"VmRSS:\s+(\d+)", pathlib.Path(f"/proc/{pid}/status").read_text()).group(1)) << 10


def descriptors(pid):
    return len(os.listdir(f"/proc/{pid}/fd"))


class Live(Case):
    def free_port(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            return free.getsockname()[1]

    def start(self, store, *arguments, workers=2, cache="64M", port=0):
        """A master with a live view and its workers. Returns the view's address."""
        self.master = subprocess.Popen([str(BIN / "quarry-master"), store, "--listen", "127.0.0.1:0", "--http", f"127.0.0.1:{port}", *arguments],
                                       stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.addCleanup(end, self.master)
        url = re.match(r"viewing (\S+)", self.master.stdout.readline()).group(1)
        self.url = url
        self.address = re.match(r"listening (\S+)", self.master.stdout.readline()).group(1)
        served = re.match(r"serving 127\.0\.0\.1:(\d+)$", self.master.stdout.readline())
        if "--viewer-url" not in arguments:
            self.assertEqual(int(served.group(1)), urllib.parse.urlsplit(url).port)
        self.workers = [self.start_worker(self.address, "--threads", 1, "--cache", cache, "--quiet") for _ in range(workers)]
        return url

    def client(self, url, **options):
        client = LiveClient(url, **options)
        self.addCleanup(client.close)
        return client

    def view(self, client, **changes):
        return {"camera": client.welcome["view"]["camera"], "size": [200, 150], "spp": 4, **changes}

    def batch(self, view):
        """The picture that a job of the same cluster makes of the view."""
        pathlib.Path(self.path("view.json")).write_text(json.dumps(view))
        self.must("quarry", "render", "-o", self.path("batch.png"), "--view", self.path("view.json"), "--master", self.address, "--force",
                  "--quiet")
        return pathlib.Path(self.path("batch.png")).read_bytes()

    def test_the_exact_picture_is_the_file_of_a_job(self):
        client = self.client(self.start(self.store("plant", 100000), cache="1M"))
        whole = client.welcome["view"]
        for mode in ("ao", "raycast", "shadow", "whitted", "path", "voxels"):
            for extra in ({}, {"exposure": 1.5}, {"spp": 7, "seed": 3, "background": [0, 0.1, 0]}):
                view = {**whole, "size": [80, 60] if mode == "path" else [200, 150], "mode": mode, **extra}
                client.want(view)
                header, images = client.until_exact(60 * PATIENCE)
                self.assertEqual(images[0], self.batch(view), f"{mode} {extra}")
                self.assertEqual((header["traced"], header["samples"]), (1, view["spp"]))
        # A view with lights of its own has no default sky, which would need a sun.
        view = {name: value for name, value in whole.items() if name != "sky"}
        view.update(size=[80, 60], mode="path", spp=2, lights=[{"type": "point", "position": [0, 0, 90], "radiance": [9000, 9000, 9000]}])
        client.want(view)
        self.assertEqual(client.until_exact(60 * PATIENCE)[1][0], self.batch(view))
        # A camera of another kind, and a smaller size after a larger one.
        view = {**whole, "size": [64, 48], "camera": {**whole["camera"], "ortho": 60}}
        del view["camera"]["fov"]
        client.want(view)
        self.assertEqual(client.until_exact(60)[1][0], self.batch(view))

    def test_bad_messages_are_answered_with_a_sentence_and_keep_their_viewer(self):
        url = self.start(self.store("plant", 20000), "--view-memory", "20M")
        good = self.client(url)
        view = self.view(good)
        bad = ["{", "[]", '{"type":"view"}', '{"type":"nothing"}', '{"type":"ack","frame":-1}', '{"type":"pick","pick":1,"origin":[0,0,0],"direction":[0,0,0]}',
               json.dumps({"type": "settings", "frame_rate": 1e9}), "[" * 1000, '{"type":"ack","frame":1,"frame":2,"more":3}',
               '{"type":"pick","pick":1,"x":1,"y":1}']  # before any view
        bad += [json.dumps({"type": "view", "input": 1, "time": 0, "moving": False, "view": {**view, **change}})
                for change in ({"size": [0, 5]}, {"size": [60000, 60000]}, {"spp": 0}, {"mode": "none"}, {"crop": [0, 0, 5, 5]}, {"aov": ["depth"]},
                               {"camera": {"eye": [0, 0, 0], "at": [0, 0, 0]}}, {"exposure": 1e9}, {"unknown": 1})]
        self.assertLess(len(bad), 20)  # as many at once as a viewer is forgiven
        client = self.client(url)
        for text in bad:
            client._send(1, text.encode())
            said = client.until("refused")
            self.assertGreater(len(said["message"]), 10, text)
        client.want(view)
        client.until_exact()
        flood = self.client(url)
        with self.assertRaises((Closed, OSError)):
            for _ in range(200):
                flood._send(1, b"{")
            self.assertRegex(flood.until("error")["message"], "messages that cannot be read")
            while True:
                flood.receive()
        large = LiveClient(url)
        with self.assertRaises((Closed, OSError)):
            large._send(1, b'"' + b"x" * (1 << 20) + b'"')
            while True:
                large.receive()
        large.close()
        good.want(view)
        good.until_exact()

    def test_starved_workers_give_whole_coarse_frames(self):
        """On a twentieth of a core, with all blocks in the cache: no frame of a moving view is a few sharp tiles beside nothing."""
        if why_not_starved():
            self.skipTest(why_not_starved())
        client = self.client(self.start(self.store("plant", 100000)))
        client.send({"type": "settings", "frame_rate": 30, "step": 0})
        view = self.view(client, size=[640, 480], mode="raycast", spp=1)
        client.want(view)
        client.until_exact(60 * PATIENCE)
        starved = Starved(0.05, [worker.pid for worker in self.workers])
        self.addCleanup(starved.end)
        eye, frames = view["camera"]["eye"], []
        for i in range(60):
            client.want({**view, "camera": {**view["camera"], "eye": [eye[0] * (1 + i / 400), *eye[1:]]}}, moving=True)
            end_s = time.monotonic() + 0.1
            while client.ready(end_s - time.monotonic()):
                got = client.receive()
                if isinstance(got, tuple):
                    frames.append(got[0])
        self.assertGreater(len(frames), 5)
        self.assertGreater(max(frame["step"] for frame in frames), 1)
        self.assertEqual([frame for frame in frames if not is_whole(frame)], [])

    def test_viewers_that_acknowledge_unread_frames_stay_within_view_memory(self):
        url = self.start(self.store("plant", 20000), "--view-memory", "88M", workers=1)
        before = resident(self.master.pid)
        deaf = [LiveClient(url, acknowledges=False, receive_buffer=4096) for _ in range(8)]
        most, number, ended = 0, 0, 0
        for client in deaf:
            self.addCleanup(client.close)
            client.send({"type": "settings", "quality": 95})
            client.want(self.view(client, size=[500, 380], spp=4096))
        end_s = time.monotonic() + 10
        while time.monotonic() < end_s and ended < 8:
            number += 1
            ended = 0
            for client in deaf:
                # Another exposure of the same rays: a whole picture, ten times a second.
                view = self.view(client, size=[500, 380], spp=4096, exposure=0.001 * number)
                try:
                    client.want(view)
                    # It does not know which frames have been sent: all that may have been.
                    for frame in range(max(1, number - 14), number + 8):
                        client.send({"type": "ack", "frame": frame})
                except OSError:
                    ended += 1
            most = max(most, resident(self.master.pid))
            time.sleep(0.08)
        print(f"  master {before >> 20} MiB before, {most >> 20} at most")
        self.assertLess(most, (88 << 20) + (64 << 20))
        # They cost the others nothing.
        for client in deaf:
            client.close()
        one = self.client(url)
        one.want(self.view(one))
        one.until_exact()

    def test_a_pick_has_the_precision_of_the_vertices_and_each_pick_is_answered(self):
        # A slope of one in 64 far away, with normals that say otherwise.
        corners = [(0, 0, 0), (4096, 0, 64), (0, 4096, 0)]
        model = "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "vn 0.6 0 0.8\n" + "f 1//1 2//1 3//1\n"
        pathlib.Path(self.path("slope.obj")).write_text(model)
        self.must("quarry-preprocess", self.path("slope.obj"), "-o", self.path("slope.quarry"), "--quiet", "--up-axis", "z")
        client = self.client(self.start(self.path("slope.quarry"), workers=1))
        client.want(self.view(client, size=[301, 301], camera={"eye": [1000, 1000, 30000], "at": [1001, 1003, 0], "up": [0, 1, 0], "fov": 12}))
        client.until_exact()
        length = math.hypot(1, 64)
        for pick in range(5):
            client.send({"type": "pick", "pick": pick, "x": 150 + pick, "y": 140.5})
            hit = client.until("picked")["hit"]
            x, y, z = hit["position"]
            self.assertLess(abs(z - x / 64), 1e-9, "the point lies in the triangle's plane")
            for got, face in zip(hit["normal"], (-1 / length, 0, 64 / length)):
                self.assertAlmostEqual(got, face, delta=1e-12)
            self.assertAlmostEqual(hit["distance"], math.dist(hit["position"], [1000, 1000, 30000]), delta=0.01)
            self.assertEqual(sorted(hit["corners"]), sorted(map(list, corners)))
            self.assertEqual(hit["part_id"], 0)
        # Along a ray of its own, from below.
        client.send({"type": "pick", "pick": 50, "origin": [640, 100, -30], "direction": [0, 0, 2]})
        hit = client.until("picked")["hit"]
        self.assertEqual((hit["position"], hit["distance"]), ([640, 100, 10], 40))
        self.assertLess(hit["normal"][2], 0)
        client.send({"type": "pick", "pick": 51, "origin": [640, 100, 30], "direction": [0, 0, 1]})
        self.assertIsNone(client.until("picked")["hit"])
        for place in ({"origin": [0, 0, 0]}, {"x": "a", "y": 0}):
            client.send({"type": "pick", "pick": 52, **place})
            self.assertIn("the browser's message", client.until("refused")["message"])
        for pick in range(100, 140):
            client.send({"type": "pick", "pick": pick, "x": pick, "y": pick})
        answered = {}
        while len(answered) < 40:
            said = client.until("picked")
            answered[said["pick"]] = said
        self.assertEqual(sorted(answered), list(range(100, 140)))
        for said in answered.values():
            self.assertTrue(said["hit"] is None or not said.get("replaced"))
        self.assertIsNotNone(answered[139]["hit"])

    def test_a_saved_picture_of_any_size_is_the_file_of_a_job(self):
        client = self.client(self.start(self.store("plant", 50000), "--frame-memory", "300M"))
        view = {**client.welcome["view"], "size": [500, 300]}
        client.want(self.view(client))
        client.send({"type": "save", "save": 1, "view": view})
        done = [client.until("saved", 60 * PATIENCE)]
        while "file" not in done[-1]:
            self.assertNotIn("error", done[-1])
            done.append(client.until("saved", 60 * PATIENCE))
        self.assertEqual(done[-1]["done"], 1)
        status, picture = client.get(done[-1]["file"])
        self.assertEqual((status, len(picture)), (200, done[-1]["bytes"]))
        self.assertEqual(picture, self.batch(view))
        self.assertEqual(client.get(done[-1]["file"], cookie=False)[0], 403)
        self.assertEqual(client.get("saved-0123456789abcdef.png")[0], 404)
        client.send({"type": "save", "save": 2, "view": {**view, "size": [60000, 60000]}})
        self.assertRegex(client.until("saved")["error"], "60000x60000 takes .* of the master's memory.*--frame-memory")
        # One that is given up, and one that is asked for again.
        client.send({"type": "save", "save": 3, "view": {**view, "spp": 4096}})
        client.send({"type": "save", "save": 4})
        client.send({"type": "save", "save": 5, "view": {**view, "size": [64, 48]}})
        said = client.until("saved", 60 * PATIENCE)
        while "file" not in said:
            said = client.until("saved", 60 * PATIENCE)
        self.assertEqual(said["save"], 5)
        self.assertEqual(client.get("access"), (200, urllib.parse.parse_qs(client.at.query)["token"][0].encode()))
        self.assertEqual(client.get("access", cookie=False)[0], 403)

    def test_a_restarted_view_keeps_its_token(self):
        store, state = self.store("plant", 20000), self.path("state")
        port = self.free_port()

        def view_once(scene, **extra):
            viewing = subprocess.Popen([str(BIN / "quarry"), "view", scene, "--http", f"127.0.0.1:{port}"], stdout=subprocess.PIPE,
                                       stderr=subprocess.PIPE, text=True, env={**os.environ, "XDG_STATE_HOME": state, **extra})
            self.addCleanup(end, viewing)
            url = viewing.stdout.readline().strip()
            client = LiveClient(url)
            client.close()
            viewing.terminate()
            viewing.wait(timeout=20)
            return url, client.cookie, viewing.stderr.read()

        first, again = view_once(store), view_once(store)
        self.assertEqual(first[:2], again[:2])
        self.assertNotIn("the token is new", first[2])
        folder = pathlib.Path(state) / "quarry/tokens"
        self.assertEqual(folder.stat().st_mode & 0o777, 0o700)
        self.assertEqual([file.stat().st_mode & 0o777 for file in folder.iterdir()], [0o600])
        pathlib.Path(self.path("other.quarry")).write_bytes(pathlib.Path(store).read_bytes())
        self.assertNotEqual(view_once(self.path("other.quarry"))[0], first[0])
        folder.chmod(0o755)
        opened = view_once(store)
        self.assertNotEqual(opened[0], first[0])
        self.assertRegex(opened[2], "the token is new.*tokens: is not a folder that this user alone may open")
        self.assertNotEqual(view_once(store, XDG_STATE_HOME="", HOME="")[0], first[0])

    def test_a_foreign_name_and_a_proxy_without_upgrade_get_a_reason(self):
        port = self.free_port()
        self.start(self.store("plant", 20000), "--viewer-url", f"http://127.0.0.1:{port}/", "--viewer-url", "https://viewer.example.org/", port=port)
        client = self.client(self.url)

        def ask(path, **headers):
            page = http.client.HTTPConnection(client.at.hostname, client.at.port, timeout=10)
            page.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
            answer = page.getresponse()
            body = answer.read().decode()
            page.close()
            return answer.status, answer.getheader("Content-Type"), body

        status, kind, body = ask("/", Host="evil.example")
        self.assertEqual((status, kind), (403, "text/html; charset=utf-8"))
        self.assertIn("--viewer-url", body)
        self.assertEqual(ask("/style.css", Host="evil.example")[0], 200)
        self.assertEqual(ask("/stats", Host="evil.example")[0], 403)
        status, _, body = ask("/live?try=abc", Cookie=client.cookie, Sec_WebSocket_Key="AAAAAAAAAAAAAAAAAAAAAA==", Sec_WebSocket_Version="13")
        self.assertEqual(status, 426)
        self.assertRegex(ask("/refusal?try=abc")[2], "proxy.*removes the headers Upgrade and Connection")
        self.assertEqual(ask("/refusal?try=abd")[0], 404)
        upgrade = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec_WebSocket_Key": "AAAAAAAAAAAAAAAAAAAAAA==", "Sec_WebSocket_Version": "13"}
        self.assertEqual(ask("/live?try=def", Cookie=client.cookie, Origin="http://viewer.example.org", Host="viewer.example.org", **upgrade)[0], 403)
        self.assertRegex(ask("/refusal?try=def")[2], "address of this page is not allowed")

    def test_views_stay_within_view_memory(self):
        url = self.start(self.store("plant", 20000), "--view-memory", "40M")
        first, second = self.client(url), self.client(url)
        limit = first.welcome["limits"]["most_pixels"]
        view = self.view(first, size=[900, int(limit / 900) - 1], mode="raycast", spp=1)
        first.want(view)
        first.until_exact()
        second.want(self.view(second, size=[400, 300]))
        said = second.receive()
        while isinstance(said, tuple) or said["type"] != "error":
            said = second.receive()
        self.assertRegex(said["message"], r"no memory for another view.*40.*--view-memory")
        first.want(self.view(first, size=[200, 150]))  # gives the rest back
        first.until_exact()
        third = self.client(url)
        third.want(self.view(third, size=[400, 300]))
        third.until_exact()

    def test_overtaken_views_are_cancelled_at_the_workers(self):
        url = self.start(self.store("plant", 100000), workers=1)
        client = self.client(url)
        endless = self.view(client, mode="whitted", spp=4096)
        client.want(endless)
        while True:  # until samples accumulate, in ranges that take long
            got = client.receive()
            if isinstance(got, tuple) and got[0]["samples"] >= 4:
                break
        time.sleep(0.3)
        times = []
        for i in range(10):
            asked = time.monotonic()
            number = client.want({**self.view(client, mode="raycast", spp=1), "seed": i})
            got = client.receive()
            while not isinstance(got, tuple) or got[0]["input"] != number:
                got = client.receive()
            times.append(time.monotonic() - asked)
            client.want({**endless, "seed": i})
            end_s = time.monotonic() + 0.4
            while client.ready(end_s - time.monotonic()):
                client.receive()
        print(f"  from input to the first frame while ranges of samples were under way: {[f'{1e3 * t:.0f} ms' for t in times]}")
        # A range under way would take minutes: its tiles have been given up.
        self.assertLess(sorted(times)[5], 5 * PATIENCE)

    def test_a_damaged_block_is_named_to_viewers(self):
        store = self.store("plant", 50000)
        data = bytearray(pathlib.Path(store).read_bytes())
        data[len(data) // 2] ^= 0x55
        pathlib.Path(store).write_bytes(data)
        said = self.client(self.start(store)).welcome
        self.assertEqual(said["type"], "error")
        self.assertRegex(said["message"], r"plant\.quarry: block \d+ at byte \d+ is damaged \(checksum\)")

    def test_a_cache_of_one_block_makes_the_same_picture(self):
        store = self.store("plant", 50000)
        client = self.client(self.start(store, cache=self.info(store)["largest_decoded_bytes"]))
        view = {**client.welcome["view"], "size": [200, 150]}
        client.want(view)
        self.assertEqual(client.until_exact(60 * PATIENCE)[1][0], self.batch(view))

    def test_files_that_are_not_models_are_refused_at_once(self):
        pathlib.Path(self.path("empty.obj")).touch()
        for name, sentence in (("empty.obj", "is empty"), ("none.ply", "No such file")):
            done = self.run_program("quarry", "view", self.path(name), "--quiet")
            self.assertEqual(done.returncode, 1)
            self.assertRegex(done.stderr, sentence)

    def test_a_job_beside_viewers_writes_the_same_file(self):
        url = self.start(self.store("plant", 100000))
        client = self.client(url)
        view = self.view(client, size=[320, 240])
        alone = self.batch(view)
        stop = threading.Event()

        def fly():
            for i in range(10000):
                if stop.is_set():
                    return
                camera = {**view["camera"], "eye": [x + 0.02 * (i % 100) for x in view["camera"]["eye"]]}
                client.want({**view, "camera": camera}, moving=True)
                while client.ready(0.03):
                    client.receive()

        thread = threading.Thread(target=fly)
        thread.start()
        try:
            self.assertEqual(self.batch(view), alone)
        finally:
            stop.set()
            thread.join()

    def test_stalled_and_vanished_viewers_leave_nothing_behind(self):
        """50 viewers connect, look, stall and vanish at random for a minute while one flies."""
        seconds = float(os.environ.get("QUARRY_CROWD_S", "60"))
        url = self.start(self.store("plant", 100000), "--view-memory", "96M")
        one = self.client(url)
        flown = self.view(one, size=[320, 240], mode="raycast", spp=1)

        def fly(for_s):
            """Frames a second of a flight."""
            begin, frames, i = time.monotonic(), 0, 0
            while (now := time.monotonic()) < begin + for_s:
                i += 1
                camera = {**flown["camera"], "eye": [x + 0.01 * (i % 500) for x in flown["camera"]["eye"]]}
                one.want({**flown, "camera": camera}, moving=True)
                while one.ready(now + 0.02 - time.monotonic()):
                    frames += isinstance(one.receive(), tuple)
            return frames / for_s

        fly(3)
        alone = fly(5)
        before, before_files = resident(self.master.pid), descriptors(self.master.pid)
        stop, refused = threading.Event(), [0]

        def come_and_go(seed):
            chance = random.Random(seed)
            while not stop.wait(chance.random()):
                try:
                    client = LiveClient(url, acknowledges=chance.random() < 0.5)
                    client.want(self.view(client, size=[chance.choice((64, 160, 320)), 120], spp=chance.choice((1, 4, 16))))
                    end_s = time.monotonic() + 2 * chance.random()
                    while not stop.is_set() and client.ready(end_s - time.monotonic()):
                        client.receive()
                except (Closed, OSError):
                    refused[0] += 1
                finally:
                    client.close()  # without a word

        crowd = [threading.Thread(target=come_and_go, args=(seed,)) for seed in range(50)]
        for thread in crowd:
            thread.start()
        most = 0
        try:
            among, rounds = [], max(1, int(seconds / 5))
            for _ in range(rounds):
                among.append(fly(5))
                most = max(most, resident(self.master.pid))
        finally:
            stop.set()
            for thread in crowd:
                thread.join()
        stalled = []
        for _ in range(20):  # these look, and then take nothing more
            client = LiveClient(url, acknowledges=False)
            client.want(self.view(client, size=[160, 120], spp=64))
            stalled.append(client)
        time.sleep(2)
        beside = fly(5)
        for client in stalled:
            client.close()
        time.sleep(3)
        after, after_files = resident(self.master.pid), descriptors(self.master.pid)
        print(f"  frames/s alone {alone:.1f}, among the crowd {sorted(among)[len(among) // 2]:.1f}, beside 20 that stall {beside:.1f}; "
              f"{refused[0]} ended; master {before >> 20} MB before, {most >> 20} at most, {after >> 20} after; files {before_files}, {after_files}")
        self.assertLess(most - before, (96 << 20) + (64 << 20))
        self.assertLess(after - before, 64 << 20)
        self.assertLess(after_files - before_files, 8)
        one.want(self.view(one))
        one.until_exact()

    def test_a_new_up_axis_turns_the_view_and_keeps_the_store(self):
        model = self.path("plant.ply")
        self.must("quarry-scene", "plant", "--triangles", 20000, "-o", model, "--quiet")
        seen, lights = {}, {}
        # The first run shows the page of the preprocessing, then the view at the same port.
        for axis, host in (("", "localhost"), ("y", "127.0.0.1"), ("z", "127.0.0.1")):
            view = subprocess.Popen([str(BIN / "quarry"), "view", model, "--http", f"{host}:0", *(["--up-axis", axis] if axis else [])],
                                    stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            self.addCleanup(end, view)
            url, told = view.stdout.readline().strip(), ""
            while "is shown until" not in told:
                told += view.stderr.readline()
            welcome = self.client(url).welcome
            scene = welcome["scene"]
            seen[axis] = scene["up_axis"], scene["views"], scene["turned_views"]
            lights[axis] = welcome["view"]["lights"], scene["turned_lights"]
            view.send_signal(signal.SIGINT)
            told += view.communicate(timeout=TIMEOUT_S)[1]
            self.assertEqual("using the store kept of it" in told, bool(axis), told)
        self.assertEqual([seen["y"][0], seen["z"][0]], ["y", "z"])
        self.assertEqual(seen[""][1]["iso"], seen[seen[""][0]][1]["iso"])
        for name in ("iso", "top", "front"):
            self.assertEqual(seen["y"][1][name], seen["z"][2][name])
            self.assertNotEqual(seen["y"][1][name], seen["z"][1][name])
        self.assertEqual(lights["y"], lights["z"][::-1])
        self.assertNotEqual(*lights["y"])

    def test_a_page_shows_the_progress_of_a_model(self):
        self.must("quarry-scene", "plant", "--triangles", 1500000, "-o", self.path("plant.ply"), "--quiet")
        viewing = subprocess.Popen([str(BIN / "quarry"), "view", self.path("plant.ply"), "--quiet"], stdout=subprocess.PIPE,
                                   stderr=subprocess.DEVNULL, text=True)
        self.addCleanup(end, viewing)
        url = urllib.parse.urlsplit(viewing.stdout.readline().strip())
        steps, cookie = set(), ""
        deadline = time.monotonic() + 60 * PATIENCE
        while time.monotonic() < deadline:
            page = http.client.HTTPConnection(url.hostname, url.port, timeout=10)
            try:
                if not cookie:
                    page.request("GET", f"/?{url.query}")
                    answer = page.getresponse()
                    self.assertIn(b"preparing", answer.read())
                    cookie = answer.getheader("Set-Cookie").split(";")[0]
                page.request("GET", "/progress", headers={"Cookie": cookie})
                answer = page.getresponse()
                body = answer.read()
                if answer.status == 404:
                    break
                steps.add(json.loads(body)["step"])
            except OSError:
                pass  # one server has ended and the next has not begun
            finally:
                page.close()
            time.sleep(0.1)
        self.assertGreater(len(steps), 1, steps)
        client = self.client(urllib.parse.urlunsplit(url))
        client.want(self.view(client))
        client.until_exact()
        viewing.terminate()
        self.assertEqual(viewing.wait(timeout=20), 1)


if __name__ == "__main__":
    main()
