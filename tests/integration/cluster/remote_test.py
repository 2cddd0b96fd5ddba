"""Stores on servers: http, https and S3, opened by every program that opens stores."""
import json
import os
import pathlib
import subprocess
import sys
import time
import unittest.mock

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, TIMEOUT_S, Case, end, main
from tests.support.servers.object_store import REGION, ObjectStore, Proxy


VIEW = ["--mode", "whitted", "--size", "320x240", "--eye", "6,6,14", "--at", "30,30,16", "--fov", "70", "--quiet"]
KEYS = ("AKEXAMPLE", "a-secret/of+S3")


class Remote(Case):
    made = None

    def setUp(self):
        super().setUp()
        self.served = self.folder / "served"
        (self.served / "models").mkdir(parents=True)
        self.remote = self.served / "models" / "plant.quarry"
        self.local = self.path("plant.quarry")
        if not Remote.made:  # once for all tests
            Remote.made = pathlib.Path(self.store("plant", 200000)).read_bytes()
        for path in (self.local, self.remote):
            pathlib.Path(path).write_bytes(Remote.made)

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

    def test_info_verify_and_render_are_those_of_the_file(self):
        server = self.serve()
        url = f"{server.url}/models/plant.quarry"
        facts, same = (json.loads(self.must("quarry", "info", s, "--json").stdout) for s in (self.local, url))
        for description in (facts, same):
            description.pop("path", None)
        self.assertEqual(facts, same)
        # No block: the other sections when the store is opened, and those of names and parts again for the paths that are printed.
        self.assertLess(server.bytes, 3 * (self.remote.stat().st_size - facts["blocks_stored_bytes"]), "info reads what it needs")
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

    def certificate(self, name="IP:127.0.0.1"):
        """The files of a certificate and its key."""
        certificate = (self.path("host.pem"), self.path("host.key"))
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", certificate[1], "-out",
                        certificate[0], "-days", "2", "-subj", "/CN=store", "-addext", f"subjectAltName={name}"], check=True, capture_output=True)
        return certificate

    def test_keys_of_any_letters(self):
        """Each is found, and its signature holds for a server that has an implementation of its own."""
        server = self.serve(keys=KEYS)
        with self.s3(server):
            for key in ("my plant v2", "100% plant %20", "Anlage S\u00fcd/\u30d7\u30e9\u30f3\u30c8", "a=b&c@d,e;f'(g)!*:$"):
                path = self.served / "models" / f"{key}.quarry"
                path.parent.mkdir(exist_ok=True)
                path.write_bytes(self.remote.read_bytes())
                self.must("quarry", "info", f"s3://models/{key}.quarry")
        self.assertEqual(server.faults, [])

    def test_region_and_endpoint_are_found_like_other_clients_do(self):
        server = self.serve(keys=KEYS, region="eu-central-1", prefix="/storage")
        with self.s3(server, AWS_DEFAULT_REGION="eu-central-1"):
            os.environ.pop("AWS_REGION")
            for end in ("/storage", "/storage/"):
                with unittest.mock.patch.dict(os.environ, {"AWS_ENDPOINT_URL": server.url + end}):
                    self.must("quarry", "info", "s3://models/plant.quarry")
        self.assertEqual(server.faults, [])

    def test_profiles_of_the_tools_of_aws(self):
        server = self.serve(keys=KEYS, region="eu-south-9")
        home = self.folder / "home"
        (home / ".aws").mkdir(parents=True)
        (home / ".aws" / "credentials").write_text(f"[default]\naws_access_key_id = other\naws_secret_access_key = other\n\n"
                                                   f"[work]\naws_access_key_id = {KEYS[0]}\naws_secret_access_key = {KEYS[1]}\n")
        (home / ".aws" / "config").write_text(f"[profile work]\nregion = eu-south-9\nendpoint_url = {server.url}\n[profile sso]\nsso_session = x\n"
                                              f"endpoint_url = {server.url}\n")
        with unittest.mock.patch.dict(os.environ, {"HOME": str(home), "AWS_PROFILE": "work"}):
            self.must("quarry", "info", "s3://models/plant.quarry")
            self.assertEqual(server.faults, [])
            self.picture("s3://models/plant.quarry")
            os.environ["AWS_PROFILE"] = "sso"
            self.must_fail(2, "export-credentials --profile sso", "quarry", "info", "s3://models/plant.quarry")
            os.environ["AWS_PROFILE"] = "absent"
            self.must_fail(2, "no profile absent", "quarry", "info", "s3://models/plant.quarry")

    def test_an_address_signed_for_get_only(self):
        query = "X-Amz-Algorithm=AWS4-HMAC-SHA256&X-Amz-Signature=0123abcd%2F"
        server = self.serve(before=lambda r: r.path.partition("?")[2] != query and (ObjectStore.refuse(r, 403, "AccessDenied"), True)[1])
        url = f"{server.url}/models/plant.quarry?{query}"
        said = self.must("quarry", "info", url, "--json")
        done = self.must("quarry", "render", url, "-o", self.path("signed.exr"), *VIEW)
        for output in (said.stderr, done.stdout, done.stderr, self.must_fail(1, "AccessDenied", "quarry", "info", url + "x").stderr):
            self.assertNotIn("0123abcd", output)

    def test_redirections(self):
        """As of releases and hubs: to an address with a signature, which another server may have."""
        heads = []
        real = self.serve(before=lambda r: heads.append(dict(r.headers.items())))
        server = self.serve(before=lambda r: ObjectStore.redirect(r, f"{real.url}/models/plant.quarry?sig=secret") if r.path.startswith("/latest/") else
                            ObjectStore.redirect(r, "/circle") if r.path.startswith("/circle") else None)
        headers = self.folder / "headers"
        headers.write_text("Authorization: Bearer token-of-mine\n")
        headers.chmod(0o600)
        url = f"{server.url}/latest/plant.quarry"
        self.must("quarry", "info", url, "--http-header-file", headers)
        self.assertEqual(self.picture(url), self.picture(self.local))
        self.assertTrue(heads)
        self.assertNotIn("token-of-mine", str(heads), "another server gets no secret")
        self.must_fail(1, "more than 5 times", "quarry", "info", f"{server.url}/circle")
        self.remote.unlink()
        refused = self.must_fail(1, r"latest/plant\.quarry: redirects to http://127\.0\.0\.1:\d+/models/plant\.quarry\?.*404 .*\(NoSuchKey\)", "quarry", "info", url)
        self.assertNotIn("secret", refused.stderr)

    def test_proxies_of_the_environment(self):
        server = self.serve()
        proxy = Proxy(server.port)
        self.addCleanup(proxy.close)
        url = "http://models.example/models/plant.quarry"
        with unittest.mock.patch.dict(os.environ, {"http_proxy": proxy.url, "no_proxy": "other.example"}):
            self.must("quarry", "info", url)
            self.assertEqual(set(proxy.targets), {url})
            self.assertEqual(self.picture(url), self.picture(self.local))
            asked = len(proxy.targets)
            self.must("quarry", "info", f"{server.url}/models/plant.quarry")
            os.environ["no_proxy"] = "other.example, .example"
            self.must_fail(1, "models.example.*cannot be reached", "quarry", "info", url)
            self.assertEqual(len(proxy.targets), asked, "loopback and no_proxy")
            os.environ.update(no_proxy="", http_proxy="socks5://127.0.0.1:1")
            self.must_fail(1, "http_proxy: only HTTP proxies", "quarry", "info", url)
        certificate = self.certificate("DNS:models.example")
        secure = self.serve(certificate=certificate)
        tunnel = Proxy(secure.port)
        self.addCleanup(tunnel.close)
        with unittest.mock.patch.dict(os.environ, {"https_proxy": tunnel.url}):
            self.must("quarry", "info", "https://models.example/models/plant.quarry", "--http-ca", certificate[0])
            self.assertEqual(set(tunnel.targets), {"models.example:443"})

    def test_authorities(self):
        certificate = self.certificate("DNS:localhost,IP:127.0.0.1")
        server = self.serve(certificate=certificate)
        url = f"{server.url}/models/plant.quarry".replace("127.0.0.1", "localhost")
        self.must_fail(1, "its certificate is not trusted: .*--http-ca", "quarry", "info", url)
        self.must("quarry", "info", url, "--http-ca", certificate[0])
        for variable in ("AWS_CA_BUNDLE", "SSL_CERT_FILE"):
            with unittest.mock.patch.dict(os.environ, {"AWS_CA_BUNDLE": "", "SSL_CERT_FILE": "", variable: certificate[0]}):
                self.must("quarry", "info", url)
        with unittest.mock.patch.dict(os.environ, {"AWS_CA_BUNDLE": certificate[0], "SSL_CERT_FILE": "/etc/ssl/certs/ca-certificates.crt"}):
            self.must("quarry", "info", url)
        fifo = self.path("fifo")
        os.mkfifo(fifo)
        self.must_fail(1, "fifo: cannot read certificate authorities: is not a plain file", "quarry", "info", url, "--http-ca", fifo)
        with unittest.mock.patch.dict(os.environ, {"SSL_CERT_FILE": fifo}):
            self.must_fail(1, "fifo, which SSL_CERT_FILE names: cannot read", "quarry", "info", url)

    def test_credentials_that_expire_midway(self):
        count = []
        server = self.serve(before=lambda r: (count.append(r), len(count) > 12 and (ObjectStore.refuse(r, 403, "ExpiredToken"), True)[1])[1])
        output = self.path("never.png")
        self.must_fail(1, r"403 Forbidden \(ExpiredToken\): the credentials have expired", "quarry", "render", f"{server.url}/models/plant.quarry", "-o", output,
                       "--retry", 5, *VIEW, "--workers", 1)
        self.assertFalse(os.path.exists(output))

    def test_a_server_that_compresses_its_answers(self):
        """Unless it is asked for the file as it is, which it is."""
        def gzip(request):
            if request.headers.get("Accept-Encoding") != "identity":
                return ObjectStore.refuse(request, 406) or True
            return False
        server = self.serve(before=gzip)
        self.must("quarry", "info", f"{server.url}/models/plant.quarry")

    def test_a_server_that_is_too_slow_is_given_up(self):
        """4 KiB a second: never silent, and too slow."""
        def trickle(request):
            size = self.remote.stat().st_size
            first, last = (int(n) for n in request.headers["Range"].removeprefix("bytes=").split("-"))
            body = self.remote.read_bytes()[first:last + 1]
            request.send_response(206)
            request.send_header("Content-Range", f"bytes {first}-{last}/{size}")
            request.send_header("Content-Length", str(len(body)))
            request.end_headers()
            try:
                for at in range(0, len(body), 4096):
                    request.wfile.write(body[at:at + 4096])
                    time.sleep(1)
            except OSError:
                pass
            return True
        server = self.serve(before=trickle)
        began = time.monotonic()
        self.must_fail(1, "is too slow: less than 16 KiB a second", "quarry", "info", f"{server.url}/models/plant.quarry")
        self.assertLess(time.monotonic() - began, 30)

    def test_a_master_and_workers_without_a_copy(self):
        """By https. The workers fetch from the server, whose address the master tells them."""
        certificate = self.certificate()
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

    def test_refused_addresses(self):
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
        self.must_fail(1, "does not state the file's size", "quarry", "info", url)
        server.tells_size = True
        damaged = bytearray(self.remote.read_bytes())
        damaged[len(damaged) // 2] ^= 1
        self.remote.write_bytes(damaged)
        self.must_fail(1, r"models/plant\.quarry: block \d+ at byte \d+ is damaged", "quarry", "verify", url)
        self.remote.write_bytes(damaged[:len(damaged) // 2])
        self.must_fail(1, "incomplete: .* of .*; fetch or make it again", "quarry", "info", url)
        self.remote.write_bytes(b"")
        self.must_fail(1, "plant.quarry", "quarry", "info", url)
        server.close()
        began = time.monotonic()
        self.must_fail(1, "plant.quarry", "quarry", "info", url)
        self.assertLess(time.monotonic() - began, TIMEOUT_S / 4)


if __name__ == "__main__":
    main()
