"""Stores on servers: http, https and S3, opened by every program that opens stores."""
import json
import os
import pathlib
import subprocess
import sys
import time
import unittest.mock

from programs import BIN, TIMEOUT_S, Case, end, main

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))
from object_store import REGION, ObjectStore  # noqa: E402

VIEW = ["--mode", "whitted", "--size", "320x240", "--eye", "6,6,14", "--at", "30,30,16", "--fov", "70", "--quiet"]
KEYS = ("AKEXAMPLE", "a-secret/of+S3")


class Remote(Case):
    def setUp(self):
        super().setUp()
        self.served = self.folder / "served"
        (self.served / "models").mkdir(parents=True)
        self.local = self.store("plant", 200000)
        self.remote = self.served / "models" / "plant.quarry"
        self.remote.write_bytes(pathlib.Path(self.local).read_bytes())

    def serve(self, **options):
        server = ObjectStore(self.served, **options)
        self.addCleanup(server.close)
        return server

    def picture(self, scene, *more):
        output = self.path("picture.exr")
        self.must("quarry", "render", scene, "-o", output, "--force", *VIEW, *more)
        return pathlib.Path(output).read_bytes()

    def s3(self, server, **more):
        """The environment of a user of S3."""
        return unittest.mock.patch.dict(os.environ, {"AWS_ENDPOINT_URL": server.url, "AWS_ACCESS_KEY_ID": KEYS[0], "AWS_SECRET_ACCESS_KEY": KEYS[1],
                                                     "AWS_REGION": REGION, **more})

    def test_info_verify_and_render_as_of_the_file(self):
        server = self.serve()
        url = f"{server.url}/models/plant.quarry"
        facts, same = (json.loads(self.must("quarry", "info", s, "--json").stdout) for s in (self.local, url))
        for description in (facts, same):
            description.pop("path", None)
        self.assertEqual(facts, same)
        self.assertLess(server.bytes, self.remote.stat().st_size / 4, "info reads what it needs")
        self.assertLess(server.requests, 16)
        self.must("quarry", "verify", url)
        before = server.bytes
        self.assertEqual(self.picture(url, "--workers", 2), self.picture(self.local))
        self.assertGreater(server.bytes, before)
        self.assertLess(server.bytes - before, 3 * self.remote.stat().st_size)
        # A picture whose camera comes from the scene, by the probe of the framing.
        framed = self.path("framed.png")
        self.must("quarry", "render", url, "-o", framed, "--size", "160x120", "--quiet")
        self.must("quarry", "render", self.local, "-o", self.path("local.png"), "--size", "160x120", "--quiet")
        self.assertEqual(pathlib.Path(framed).read_bytes(), pathlib.Path(self.path("local.png")).read_bytes())

    def test_s3_with_signatures(self):
        server = self.serve(keys=KEYS)
        (self.served / "models" / "a plant+more.quarry").write_bytes(self.remote.read_bytes())
        with self.s3(server):
            self.must("quarry", "verify", "s3://models/plant.quarry")
            self.must("quarry", "info", "s3://models/a plant+more.quarry")
            self.assertEqual(self.picture("s3://models/plant.quarry"), self.picture(self.local))
        self.assertEqual(server.faults, [])
        with self.s3(server, AWS_SECRET_ACCESS_KEY="another"):
            self.must_fail(1, r"models/plant\.quarry: .*403", "quarry", "info", "s3://models/plant.quarry")
        self.assertEqual(set(server.faults), {"another signature"})
        credentials = self.folder / "credentials"
        credentials.write_text(json.dumps({"AccessKeyId": KEYS[0], "SecretAccessKey": KEYS[1], "Region": REGION}))
        credentials.chmod(0o600)
        self.must("quarry", "info", f"{server.url}/models/plant.quarry", "--http-aws", str(credentials))

    def test_a_master_and_workers_without_a_copy(self):
        """By https. The workers fetch from the server, whose address the master tells them."""
        certificate = (self.path("host.pem"), self.path("host.key"))
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", certificate[1], "-out",
                        certificate[0], "-days", "2", "-subj", "/CN=127.0.0.1", "-addext", "subjectAltName=IP:127.0.0.1"], check=True, capture_output=True)
        server = self.serve(certificate=certificate)
        url = f"{server.url}/models/plant.quarry"
        self.must_fail(1, "certificate", "quarry", "info", url)
        master, address = self.start_master(url, "--http-ca", certificate[0], "--foresight", "0")
        for _ in range(2):
            self.start_worker(address, "--threads", 1, "--http-ca", certificate[0], "--peers", "off")
        output = self.path("cluster.exr")
        self.must("quarry", "render", "-o", output, "--master", address, *VIEW, "--stats", self.path("stats.json"))
        self.assertEqual(pathlib.Path(output).read_bytes(), self.picture(self.local))
        workers = json.loads(pathlib.Path(self.path("stats.json")).read_text())["frames"][0]["workers"]
        self.assertGreater(sum(w["voxel_bytes_from_http"] for w in workers), 0, workers)
        self.assertEqual(sum(w["voxel_bytes_from_tcp"] for w in workers), 0, workers)
        self.assertIsNone(master.poll())

    def test_a_server_that_fails_for_a_while(self):
        server = self.serve()
        server.fail_next = 4
        self.must("quarry", "verify", f"{server.url}/models/plant.quarry", "--quiet")
        self.assertEqual(server.fail_next, 0)

    def test_what_cannot_be(self):
        server = self.serve()
        url = f"{server.url}/models/plant.quarry"
        self.must_fail(1, r"absent\.quarry: .*404", "quarry", "info", f"{server.url}/absent.quarry")
        self.must_fail(1, r"absent\.quarry: .*404", "quarry", "render", f"{server.url}/absent.quarry", "-o", self.path("no.png"))
        self.must_fail(1, r"absent\.quarry: .*404", "quarry-master", f"{server.url}/absent.quarry", "--listen", "127.0.0.1:0")
        self.must_fail(2, "s3://BUCKET/KEY", "quarry", "info", "s3://models")
        self.must_fail(2, "user", "quarry", "info", "https://user@host/x")
        server.ranges = False
        self.must_fail(1, "range", "quarry", "info", url)
        server.ranges, server.tells_size = True, False
        self.must_fail(1, "does not tell the file's size", "quarry", "info", url)
        server.tells_size = True
        damaged = bytearray(self.remote.read_bytes())
        damaged[len(damaged) // 2] ^= 1
        self.remote.write_bytes(damaged)
        self.must_fail(1, r"models/plant\.quarry: block \d+ at byte \d+ is damaged", "quarry", "verify", url)
        self.remote.write_bytes(damaged[:len(damaged) // 2])
        self.must_fail(1, "truncated or added to", "quarry", "info", url)
        self.remote.write_bytes(b"")
        self.must_fail(1, "plant.quarry", "quarry", "info", url)
        server.close()
        began = time.monotonic()
        self.must_fail(1, "plant.quarry", "quarry", "info", url)
        self.assertLess(time.monotonic() - began, TIMEOUT_S / 4)


if __name__ == "__main__":
    main()
