"""TLS between the programs: by a shared secret, by certificates, and the limits of strangers."""
import http.server
import os
import pathlib
import re
import secrets
import socket
import ssl
import subprocess
import sys
import threading
import time
import unittest
import unittest.mock

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, Case, end, main

VIEW = ["--size", "256x192", "--mode", "whitted", "--quiet"]
PATIENCE_S = 60  # for events that must happen at some time


class Security(Case):
    def setUp(self):
        super().setUp()
        self.scene = self.store("plant", 20000)

    def secret(self, name="secret", text=None, mode=0o600):
        path = self.folder / name
        path.write_text(text or secrets.token_hex(32) + "\n")
        path.chmod(mode)
        return str(path)

    def master(self, *arguments, listen="127.0.0.1:0"):
        """One that logs: the process and its address on loopback."""
        log = open(self.path(f"master-{secrets.token_hex(4)}.log"), "w+")
        self.addCleanup(log.close)
        process = subprocess.Popen([str(BIN / "quarry-master"), self.scene, "--listen", listen, *map(str, arguments)],
                                   stdout=subprocess.PIPE, stderr=log, text=True)
        self.addCleanup(end, process)
        match = re.match(r"listening \S+:(\d+)", process.stdout.readline())
        self.assertTrue(match, "the master does not listen")
        process.log = log
        return process, f"127.0.0.1:{match.group(1)}"

    def log(self, master):
        return pathlib.Path(master.log.name).read_text().splitlines()

    def await_lines(self, master, pattern, count):
        """The log's lines that match, once there are `count` of them; and no more."""
        until = time.monotonic() + PATIENCE_S
        while True:
            lines = [line for line in self.log(master) if re.search(pattern, line)]
            if len(lines) >= count or time.monotonic() > until:
                self.assertEqual(len(lines), count, self.log(master))
                return lines
            time.sleep(0.05)

    def picture(self, name, *arguments):
        output = self.path(name + ".png")
        self.must("quarry", "render", self.scene, "-o", output, *VIEW, *arguments)
        return pathlib.Path(output).read_bytes()

    def both_fail(self, sentence, address, *arguments):
        """A client and a worker that will not try again."""
        self.must_fail(1, sentence, "quarry", "render", self.scene, "-o", self.path("no.png"), *VIEW, "--master", address, *arguments)
        # It would try for an hour.
        self.must_fail(1, sentence, "quarry-worker", "--master", address, "--retry", 3600, *arguments)
        self.assertFalse(os.path.exists(self.path("no.png")))


class BySecret(Security):
    def test_the_picture_is_the_plain_one(self):
        plain = self.picture("plain", "--workers", 2)
        secret = self.secret()
        _, address = self.master("--secret-file", secret)
        for _ in range(2):
            self.start_worker(address, "--secret-file", secret, "--threads", 1, "--quiet")
        self.assertEqual(self.picture("tls", "--master", address, "--secret-file", secret), plain)
        with unittest.mock.patch.dict(os.environ, QUARRY_SECRET_FILE=secret):
            self.assertEqual(self.picture("environment", "--master", address), plain)
        self.assertEqual(self.picture("local", "--workers", 2, "--secret-file", secret), plain)
        # A cluster of the command's own stays plain, whatever the environment says of others.
        with unittest.mock.patch.dict(os.environ, QUARRY_SECRET_FILE="/no/such/secret"):
            self.assertEqual(self.picture("local-plain", "--workers", 2), plain)
            self.must_fail(2, r"/no/such/secret: cannot open", "quarry-worker", "--master", address)

    def test_no_byte_travels_in_the_clear(self):
        secret = self.secret()
        for arguments, clear in (((), True), (("--secret-file", secret), False)):
            _, address = self.master(*arguments)
            self.start_worker(address, *arguments, "--quiet")
            wire = Wire(address)
            self.addCleanup(wire.close)
            self.picture("wire", "--master", wire.address, *arguments)
            self.assertGreater(len(wire.bytes), 2000)
            for word in (b"QUARRY\0\0", b"QRY1", b"IHDR"):
                self.assertEqual(word in wire.bytes, clear, word)

    def test_incompatible_peers_get_a_reason_and_harm_nobody(self):
        secret, other = self.secret(), self.secret("other")
        master, address = self.master("--secret-file", secret)
        self.both_fail(r"127\.0\.0\.1:\d+ does not take this side's secret", address, "--secret-file", other)
        self.await_lines(master, r"127\.0\.0\.1:\d+ has another secret", 2)
        self.both_fail(r"127\.0\.0\.1:\d+ asks for TLS; give --secret-file", address)
        self.await_lines(master, r"127\.0\.0\.1:\d+ does not speak TLS", 2)
        self.start_worker(address, "--secret-file", secret, "--quiet")
        self.picture("after", "--master", address, "--secret-file", secret)
        plain, address = self.master()
        self.both_fail(r"127\.0\.0\.1:\d+ does not speak TLS; start it with --secret-file", address, "--secret-file", secret)
        self.await_lines(plain, r"127\.0\.0\.1:\d+ speaks TLS; this side was started without", 2)
        self.start_worker(address, "--quiet")
        self.picture("after", "--master", address)

    def test_beyond_loopback_only_with_tls(self):
        for mode in ((), ("--serve-only",)):
            self.must_fail(2, r"0\.0\.0\.0:0, which is not a loopback address.*give --secret-file", "quarry-master", self.scene,
                           "--listen", "0.0.0.0:0", *mode)
        secret = self.secret()
        self.master("--secret-file", secret, "--serve-only", listen="0.0.0.0:0")
        _, address = self.master("--secret-file", secret, listen="0.0.0.0:0")
        self.start_worker(address, "--secret-file", secret, "--quiet")
        self.picture("everywhere", "--master", address, "--secret-file", secret)

    def test_weak_secrets_are_refused(self):
        for arguments in (("quarry-master", self.scene, "--listen", "127.0.0.1:0"), ("quarry-worker", "--master", "127.0.0.1:1"),
                          ("quarry", "render", self.scene, "-o", self.path("x.png"))):
            self.must_fail(2, r"a secret of 8 bytes can be guessed", *arguments, "--secret-file", self.secret("short", "12345678"))
            self.must_fail(2, r"users other than its owner may read this secret; chmod 600", *arguments, "--secret-file",
                           self.secret("open", mode=0o644))
            self.must_fail(2, r"cannot be used together", *arguments, "--secret-file", self.secret(), "--tls-ca", "x")


class ByCertificates(Security):
    def authority(self, name):
        self.certificate(name, None, "-addext", "keyUsage=keyCertSign")

    def certificate(self, name, authority, *extra):
        signed = ["-CA", self.path(authority + ".pem"), "-CAkey", self.path(authority + ".key")] if authority else []
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
                        "-subj", f"/CN={name}", "-keyout", self.path(name + ".key"), "-out", self.path(name + ".pem"), *signed, *extra],
                       check=True, capture_output=True, timeout=PATIENCE_S)

    def options(self, own, authority):
        return ["--tls-cert", self.path(own + ".pem"), "--tls-key", self.path(own + ".key"), "--tls-ca", self.path(authority + ".pem")]

    def setUp(self):
        super().setUp()
        self.authority("ca")
        self.authority("stranger-ca")
        self.certificate("server", "ca", "-addext", "subjectAltName=IP:127.0.0.1,DNS:localhost")
        self.certificate("elsewhere", "ca", "-addext", "subjectAltName=IP:192.0.2.1,DNS:example.org")
        self.certificate("client", "ca")
        self.certificate("stranger", "stranger-ca", "-addext", "subjectAltName=IP:127.0.0.1")

    def test_the_picture_is_the_plain_one(self):
        _, address = self.master(*self.options("server", "ca"))
        for _ in range(2):
            self.start_worker(address, *self.options("client", "ca"), "--threads", 1, "--quiet")
        plain = self.picture("plain", "--workers", 2)
        self.assertEqual(self.picture("tls", "--master", address, *self.options("client", "ca")), plain)
        by_name = address.replace("127.0.0.1", "localhost")
        self.assertEqual(self.picture("tls", "--master", by_name, *self.options("client", "ca")), plain)

    def test_certificates_that_do_not_fit(self):
        master, address = self.master(*self.options("server", "ca"))
        self.both_fail(r"asks for a certificate; give --tls-cert", address, "--tls-ca", self.path("ca.pem"))
        self.await_lines(master, r"127\.0\.0\.1:\d+ shows no certificate", 2)
        self.both_fail(r"does not take this side's certificate \(unknown CA\)", address, *self.options("stranger", "ca"))
        self.await_lines(master, r"127\.0\.0\.1:\d+ shows a certificate that does not fit", 2)
        self.both_fail(r"shows a certificate that does not fit: self-signed certificate in certificate chain", address, *self.options("client", "stranger-ca"))
        self.await_lines(master, r"127\.0\.0\.1:\d+ does not take this side's certificate \(unknown CA\)", 2)
        self.both_fail(r"asks for TLS; give --secret-file, or --tls-ca", address)
        self.await_lines(master, r"127\.0\.0\.1:\d+ does not speak TLS; give it --tls-ca", 2)
        self.both_fail(r"uses certificates instead of a secret", address, "--secret-file", self.secret())
        self.start_worker(address, *self.options("client", "ca"), "--quiet")
        self.picture("after", "--master", address, *self.options("client", "ca"))

        _, address = self.master(*self.options("elsewhere", "ca"))
        self.both_fail(r"shows a certificate that does not fit: IP address mismatch", address, *self.options("client", "ca"))
        by_name = address.replace("127.0.0.1", "localhost")
        self.both_fail(r"shows a certificate that does not fit: hostname mismatch", by_name, *self.options("client", "ca"))

        master, address = self.master("--secret-file", self.secret())
        self.both_fail(r"has no certificate to show; give --secret-file", address, *self.options("client", "ca"))
        self.await_lines(master, r"127\.0\.0\.1:\d+ speaks TLS without the secret", 2)

    def test_a_server_that_lets_everybody_in_is_refused(self):
        own = ["--tls-cert", self.path("server.pem"), "--tls-key", self.path("server.key")]
        self.must_fail(2, r"--tls-cert needs --tls-ca too: .*anybody could join", "quarry-master", self.scene, *own)
        self.must_fail(2, r"client\.key: not a private key .* or not .*server\.pem's", "quarry-master", self.scene, "--tls-cert",
                       self.path("server.pem"), "--tls-key", self.path("client.key"), "--tls-ca", self.path("ca.pem"))

    def test_a_peer_that_never_greets_is_dropped(self):
        master, address = self.master(*self.options("server", "ca"))
        context = ssl.create_default_context(cafile=self.path("ca.pem"))
        context.load_cert_chain(self.path("client.pem"), self.path("client.key"))
        host, port = address.split(":")
        with context.wrap_socket(socket.create_connection((host, int(port))), server_hostname=host) as peer:
            self.assertEqual(peer.version(), "TLSv1.3")
            peer.settimeout(PATIENCE_S)
            said = b""
            while True:
                try:
                    more = peer.recv(100)
                except (ssl.SSLEOFError, ConnectionResetError):
                    break
                if not more:
                    break
                said += more
            # It came through the handshake, so the preamble came; nothing else.
            self.assertTrue(said.startswith(b"QUARRY") and len(said) == 32, said)
            self.await_lines(master, f"127.0.0.1:{peer.getsockname()[1]} does not answer", 1)

    def test_no_older_tls(self):
        master, address = self.master(*self.options("server", "ca"))
        context = ssl.create_default_context(cafile=self.path("ca.pem"))
        context.maximum_version = ssl.TLSVersion.TLSv1_2
        host, port = address.split(":")
        with socket.create_connection((host, int(port))) as peer, self.assertRaises(ssl.SSLError):
            context.wrap_socket(peer, server_hostname=host)
        self.await_lines(master, r"does not speak TLS 1\.3", 1)


class Strangers(Security):
    GARBAGE = [b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", b"QUARRY\0\0" + bytes(400), b"\x16\x03\x01\x00\x05hello", b"\x16\x03\x01\xff\xff" + b"x" * 100,
               b"\x80\x2e\x01\x03\x01" + bytes(60), b"\x15\x03\x03\x00\x02\x02\x28", bytes(1000), os.urandom(5000)]

    def against_strangers(self, *arguments):
        master, address = self.master(*arguments)
        host, port = address.split(":")
        self.start_worker(address, *arguments, "--threads", 1, "--quiet")
        idle = [socket.create_connection((host, int(port))) for _ in range(100)]
        garbage = []
        for junk in self.GARBAGE:
            peer = socket.create_connection((host, int(port)))
            peer.sendall(junk)
            peer.shutdown(socket.SHUT_WR)
            garbage.append(peer)
        half = socket.create_connection((host, int(port)))
        half.sendall(b"\x16\x03\x01\x02\x00\x01" if arguments else b"QUARRY\0\0")  # the beginning of a right greeting
        idle += [half] + [socket.create_connection((host, int(port))) for _ in range(100)]
        picture = self.picture("among-strangers", "--master", address, *arguments)
        self.assertEqual(picture, self.picture("alone"))
        for peer in idle + garbage:
            with peer:
                peer.settimeout(PATIENCE_S)
                try:
                    while peer.recv(1000):
                        pass
                except ConnectionResetError:
                    pass
                self.await_lines(master, rf"127\.0\.0\.1:{peer.getsockname()[1]}\b", 1)
        self.assertIsNone(master.poll())
        self.picture("after", "--master", address, *arguments)

    def test_plain(self):
        self.against_strangers()

    def test_tls(self):
        self.against_strangers("--secret-file", self.secret())


class Wire:
    """Between a client and the server at `address`: keeps the bytes that pass, both ways."""

    def __init__(self, address):
        host, port = address.split(":")
        self.server = (host, int(port))
        self.bytes = bytearray()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.listener.getsockname()[1]}"
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        try:
            while True:
                client, _ = self.listener.accept()
                server = socket.create_connection(self.server)
                for source, target in ((client, server), (server, client)):
                    threading.Thread(target=self.copy, args=(source, target), daemon=True).start()
        except OSError:
            pass  # closed

    def copy(self, source, target):
        try:
            while data := source.recv(65536):
                self.bytes += data
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)
        except OSError:
            pass

    def close(self):
        self.listener.close()


class Tokens(Case):
    """Headers go to hosts that the worker's own command line names."""

    def setUp(self):
        super().setUp()
        self.scene = self.store("plant", 20000)
        self.token = self.folder / "token"
        self.token.write_text("X-Token: open sesame\n")
        self.token.chmod(0o600)
        self.heard = heard = []

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                heard.append(self.headers.get("X-Token"))
                self.send_error(404)

            def log_message(self, *_):
                pass

        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        self.addCleanup(server.server_close)
        self.addCleanup(server.shutdown)
        self.port = server.server_address[1]
        self.url = f"http://127.0.0.1:{self.port}/plant.quarry"

    def tokens(self, of_master, of_worker):
        """The tokens that the server received."""
        self.heard.clear()
        master, address = self.start_master(self.scene, *of_master)
        worker = self.start_worker(address, "--http-header-file", self.token, *of_worker)
        self.must("quarry", "render", self.scene, "-o", self.path("x.png"), "--master", address, *VIEW)
        end(worker)
        end(master)
        self.assertTrue(self.heard)
        return set(self.heard)

    def test_tokens_are_sent_only_to_hosts_that_the_worker_names(self):
        named, both = ["--source", self.url, "--source", "master"], ["--http-header-host", "127.0.0.1"]
        self.assertEqual(self.tokens(named, []), {None})
        self.assertEqual(self.tokens(named, ["--http-header-host", "elsewhere.example"]), {None})
        self.assertEqual(self.tokens(named, ["--http-header-host", f"127.0.0.1:{self.port + 1}"]), {None})
        self.assertEqual(self.tokens(named, both), {"open sesame"})
        self.assertEqual(self.tokens(named, ["--http-header-host", f"127.0.0.1:{self.port}"]), {"open sesame"})
        self.assertEqual(self.tokens([], named), {"open sesame"})
        self.must_fail(2, "--http-header-host is HOST or HOST:PORT", "quarry-worker", "--master", "127.0.0.1:1", "--http-header-host",
                       "http://a/b")

    @unittest.skipUnless(os.geteuid() == 0, "only root can read another user's secret")
    def test_a_secret_that_another_user_owns_is_refused(self):
        """Root could read it; its owner could change it at any time."""
        for name, text, arguments in (("secret", "0123456789abcdef" * 2, ["quarry-master", self.scene, "--listen", "127.0.0.1:0", "--secret-file"]),
                                      ("headers", "Authorization: x", ["quarry", "info", "http://127.0.0.1:1/x", "--http-header-file"]),
                                      ("keys", "{}", ["quarry", "info", "s3://a/b", "--http-aws"])):
            path = self.folder / name
            path.write_text(text)
            path.chmod(0o600)
            os.chown(path, 65534, 65534)
            self.must_fail(2, f"{name}: belongs to another user \\(65534\\)", *arguments, path)

    def test_a_private_key_that_others_may_use_is_refused(self):
        subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost", "-keyout",
                        self.path("key"), "-out", self.path("cert")], check=True, capture_output=True)
        for mode in (0o640, 0o604, 0o620, 0o660, 0o644):
            os.chmod(self.path("key"), mode)
            self.must_fail(2, "users other than its owner may use this private key; chmod 600", "quarry-master", self.scene, "--listen",
                           "127.0.0.1:0", "--tls-cert", self.path("cert"), "--tls-key", self.path("key"), "--tls-ca", self.path("cert"))
        os.mkfifo(self.path("fifo"))
        self.must_fail(2, "is not a regular file", "quarry-master", self.scene, "--listen", "127.0.0.1:0", "--tls-cert",
                       self.path("fifo"), "--tls-key", self.path("key"), "--tls-ca", self.path("cert"))


if __name__ == "__main__":
    main()
