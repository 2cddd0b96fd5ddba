"""The live view without a browser: exactness, limits, a crowd of viewers, jobs beside it, the page of a model that is being made."""
import http.client
import json
import os
import pathlib
import random
import re
import subprocess
import sys
import threading
import time
import urllib.parse

from programs import BIN, PATIENCE, Case, end, main

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))
from live_client import Closed, LiveClient  # noqa: E402


def resident(pid):
    """Bytes that a process has in memory now."""
    return int(re.search(r"VmRSS:\s+(\d+)", pathlib.Path(f"/proc/{pid}/status").read_text()).group(1)) << 10


def descriptors(pid):
    return len(os.listdir(f"/proc/{pid}/fd"))


class Live(Case):
    def start(self, store, *arguments, workers=2, cache="64M"):
        """A master with a live view and its workers. Returns the view's address."""
        self.master = subprocess.Popen([str(BIN / "quarry-master"), store, "--listen", "127.0.0.1:0", "--http", "127.0.0.1:0", *arguments],
                                       stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.addCleanup(end, self.master)
        url = re.match(r"viewing (\S+)", self.master.stdout.readline()).group(1)
        self.address = re.match(r"listening (\S+)", self.master.stdout.readline()).group(1)
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

    def test_what_is_exact_is_the_file_that_a_job_writes(self):
        client = self.client(self.start(self.store("plant", 100000), cache="1M"))
        whole = client.welcome["view"]
        for mode in ("ao", "raycast", "shadow", "whitted", "voxels"):
            for extra in ({}, {"exposure": 1.5}, {"spp": 7, "seed": 3, "background": [0, 0.1, 0]}):
                view = {**whole, "size": [200, 150], "mode": mode, **extra}
                client.want(view)
                header, images = client.until_exact(60 * PATIENCE)
                self.assertEqual(images[0], self.batch(view), f"{mode} {extra}")
                self.assertEqual((header["traced"], header["samples"]), (1, view["spp"]))
        # A camera of another kind, and a smaller size after a larger one.
        view = {**whole, "size": [64, 48], "camera": {**whole["camera"], "ortho": 60}}
        del view["camera"]["fov"]
        client.want(view)
        self.assertEqual(client.until_exact(60)[1][0], self.batch(view))

    def test_bad_messages_end_their_viewer_with_a_sentence_and_nobody_else(self):
        url = self.start(self.store("plant", 20000), "--view-memory", "20M")
        good = self.client(url)
        view = self.view(good)
        bad = ["{", "[]", '{"type":"view"}', '{"type":"nothing"}', '{"type":"ack","frame":-1}', '{"type":"pick","pick":1,"x":"a","y":0}',
               json.dumps({"type": "settings", "frame_rate": 1e9}), "[" * 1000, '{"type":"ack","frame":1,"frame":2,"more":3}']
        bad += [json.dumps({"type": "view", "input": 1, "time": 0, "moving": False, "view": {**view, **change}})
                for change in ({"size": [0, 5]}, {"size": [60000, 60000]}, {"spp": 0}, {"mode": "none"}, {"crop": [0, 0, 5, 5]}, {"aov": ["depth"]},
                               {"camera": {"eye": [0, 0, 0], "at": [0, 0, 0]}}, {"exposure": 1e9}, {"unknown": 1})]
        for text in bad:
            client = LiveClient(url)
            client._send(1, text.encode())
            said = client.receive()
            while isinstance(said, tuple) or said["type"] in ("stats", "state"):
                said = client.receive()
            self.assertEqual(said["type"], "error", text)
            self.assertGreater(len(said["message"]), 10)
            with self.assertRaises(Closed):
                while True:
                    client.receive()
            client.close()
        large = LiveClient(url)
        with self.assertRaises((Closed, OSError)):
            large._send(1, b'"' + b"x" * (1 << 20) + b'"')
            while True:
                large.receive()
        large.close()
        good.want(view)
        good.until_exact()

    def test_views_take_no_more_memory_than_they_may(self):
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
        self.assertRegex(said["message"], r"too many viewers.*40.*--view-memory")
        first.want(self.view(first, size=[200, 150]))  # gives the rest back
        first.until_exact()
        third = self.client(url)
        third.want(self.view(third, size=[400, 300]))
        third.until_exact()

    def test_views_that_are_overtaken_are_abandoned_at_the_workers(self):
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

    def test_models_that_cannot_be_are_refused_at_once(self):
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

    def test_a_crowd_that_stalls_and_vanishes_leaves_nothing_behind(self):
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

    def test_a_model_has_a_page_that_says_how_far_it_is(self):
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
