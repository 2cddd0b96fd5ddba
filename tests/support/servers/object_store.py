"""A server of files with range requests, as an object store is one: optionally by https, and with signatures of S3 (Signature V4) that it
checks by an implementation of its own, from the published rules."""
import datetime
import hashlib
import hmac
import http.client
import http.server
import pathlib
import re
import select
import socket
import ssl
import threading
import urllib.parse

REGION = "eu-test-1"


def _hmac(key, text):
    return hmac.new(key, text.encode(), hashlib.sha256).digest()


def signature_fault(method, target, headers, access_key, secret_key, region):
    """Why a request's signature is not right; None: it is."""
    match = re.fullmatch(r"AWS4-HMAC-SHA256 Credential=([^/]+)/(\d{8})/([^/]+)/s3/aws4_request, ?SignedHeaders=([^,]+), ?Signature=([0-9a-f]{64})",
                         headers.get("Authorization", ""))
    if not match:
        return "no signature"
    key, day, named_region, names, signature = match.groups()
    if key != access_key or named_region != region:
        return "another key or region"
    stamp = headers.get("x-amz-date", "")
    then = datetime.datetime.strptime(stamp, "%Y%m%dT%H%M%SZ").replace(tzinfo=datetime.timezone.utc)
    if abs((datetime.datetime.now(datetime.timezone.utc) - then).total_seconds()) > 900 or not stamp.startswith(day):
        return "another time"
    signed = names.split(";")
    for name in ("host", "range", "x-amz-content-sha256", "x-amz-date"):
        if name not in signed:
            return f"{name} is not signed"
    path, _, query = target.partition("?")
    pairs = sorted(urllib.parse.parse_qsl(query, keep_blank_values=True))
    canonical = "\n".join([method, path, "&".join(f"{urllib.parse.quote(k, safe='-_.~')}={urllib.parse.quote(v, safe='-_.~')}" for k, v in pairs),
                           "".join(f"{name}:{' '.join(headers.get(name, '').split())}\n" for name in signed), names, headers["x-amz-content-sha256"]])
    scope = f"{day}/{region}/s3/aws4_request"
    text = "\n".join(["AWS4-HMAC-SHA256", stamp, scope, hashlib.sha256(canonical.encode()).hexdigest()])
    derived = _hmac(_hmac(_hmac(_hmac(b"AWS4" + secret_key.encode(), day), region), "s3"), "aws4_request")
    right = hmac.new(derived, text.encode(), hashlib.sha256).hexdigest()
    return None if hmac.compare_digest(right, signature) else "another signature"


class ObjectStore:
    """Serves `folder` at http://127.0.0.1:PORT/. `keys`: (access key, secret key) that requests must be signed by, in `region`. `prefix`: the path below
    which it serves. `before`: called with each request first; it may answer, and return True."""

    def __init__(self, folder, keys=None, certificate=None, region=REGION, prefix="", before=None):
        self.folder, self.keys, self.region, self.prefix, self.before = pathlib.Path(folder), keys, region, prefix, before
        self.requests, self.bytes, self.faults = 0, 0, []
        self.fail_next, self.ranges, self.tells_size = 0, True, True
        store = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            disable_nagle_algorithm = True

            def do_GET(self):
                store.answer(self)

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        if certificate:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(*certificate)
            self.server.socket = context.wrap_socket(self.server.socket, server_side=True)
        self.port = self.server.server_address[1]
        self.url = f"{'https' if certificate else 'http'}://127.0.0.1:{self.port}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def close(self):
        self.server.shutdown()
        self.server.server_close()

    def answer(self, request):
        self.requests += 1
        if self.fail_next > 0:
            self.fail_next -= 1
            return self.refuse(request, 503)
        if self.before and self.before(request):
            return None
        if self.keys:
            fault = signature_fault("GET", request.path, {k: v for k, v in request.headers.items()} | {
                k.lower(): v for k, v in request.headers.items()}, *self.keys, self.region)
            if fault:
                self.faults.append(fault)
                return self.refuse(request, 403)
        place = urllib.parse.unquote(request.path.partition("?")[0])
        path = self.folder / place.removeprefix(self.prefix).lstrip("/")
        if not place.startswith(self.prefix + "/") or not path.is_file():
            return self.refuse(request, 404, "NoSuchKey")
        size = path.stat().st_size
        match = re.fullmatch(r"bytes=(\d+)-(\d+)", request.headers.get("Range", ""))
        if not match or not self.ranges:
            request.send_response(200)
            request.send_header("Content-Length", str(size))
            request.end_headers()
            self.write(request, path.read_bytes())
            return None
        if int(match.group(1)) >= size:
            return self.refuse(request, 416)
        first, last = int(match.group(1)), min(int(match.group(2)), size - 1)
        with open(path, "rb") as file:
            file.seek(first)
            body = file.read(last - first + 1)
        self.bytes += len(body)
        request.send_response(206)
        request.send_header("Content-Range", f"bytes {first}-{last}/{size if self.tells_size else '*'}")
        request.send_header("Content-Length", str(len(body)))
        request.end_headers()
        self.write(request, body)
        return None

    @staticmethod
    def write(request, body):
        try:
            request.wfile.write(body)
        except OSError:
            pass  # the program has gone

    @staticmethod
    def refuse(request, status, code=""):
        body = f"<?xml version=\"1.0\"?>\n<Error><Code>{code}</Code><Message>a message</Message></Error>".encode() if code else b""
        request.send_response(status)
        request.send_header("Content-Length", str(len(body)))
        request.end_headers()
        ObjectStore.write(request, body)

    @staticmethod
    def redirect(request, target):
        request.send_response(302)
        request.send_header("Location", target)
        request.send_header("Content-Length", "0")
        request.end_headers()
        return True


class Proxy:
    """A proxy for HTTP at http://127.0.0.1:PORT that sends every request on to `port` of this machine, whatever host it names. `targets`: the
    targets of its requests."""

    def __init__(self, port):
        self.targets = []
        proxy = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self):
                proxy.targets.append(self.path)
                url = urllib.parse.urlsplit(self.path)
                there = http.client.HTTPConnection("127.0.0.1", port)
                there.request("GET", url.path, headers=dict(self.headers.items()))
                answer = there.getresponse()
                body = answer.read()
                self.send_response(answer.status)
                for name, value in answer.headers.items():
                    if name.lower() in ("content-range", "content-length"):
                        self.send_header(name, value)
                self.end_headers()
                self.wfile.write(body)

            def do_CONNECT(self):
                proxy.targets.append(self.path)
                self.send_response(200)
                self.end_headers()
                with socket.create_connection(("127.0.0.1", port)) as there:
                    ends = {there: self.connection, self.connection: there}
                    while True:
                        for end in select.select(list(ends), [], [], 60)[0]:
                            data = end.recv(65536)
                            if not data:
                                self.close_connection = True
                                return
                            ends[end].sendall(data)

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def close(self):
        self.server.shutdown()
        self.server.server_close()
