"""A viewer without a browser: speaks the display's protocol (master/display/PROTOCOL.md) over a socket of its own."""
import base64
import http.client
import json
import os
import re
import select
import socket
import struct
import time
import urllib.parse


class Closed(Exception):
    """The server has closed the connection."""


class LiveClient:
    """A WebSocket to a display. `url`: as the master prints it, with its token. Received frames are (header, images)."""

    def __init__(self, url, acknowledges=True, timeout=30, receive_buffer=0):
        at = urllib.parse.urlsplit(url)
        self.at = at
        self.acknowledges, self.buffer, self.pieces, self.bytes = acknowledges, b"", b"", 0
        page = http.client.HTTPConnection(at.hostname, at.port, timeout=timeout)
        page.request("GET", f"{at.path}?{at.query}")
        answer = page.getresponse()
        answer.read()
        self.cookie = (answer.getheader("Set-Cookie") or "").split(";")[0]
        page.close()
        self.socket = socket.socket(socket.AF_INET)
        self.socket.settimeout(timeout)
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.connect((at.hostname, at.port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall((f"GET {at.path}live HTTP/1.1\r\nHost: {at.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                             f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\nOrigin: {at.scheme}://{at.netloc}\r\n"
                             f"Cookie: {self.cookie}\r\n\r\n").encode())
        while b"\r\n\r\n" not in self.buffer:
            self._fill()
        head, self.buffer = self.buffer.split(b"\r\n\r\n", 1)
        self.status = int(re.match(rb"HTTP/1.1 (\d+)", head).group(1))
        if self.status != 101:
            raise Closed(f"status {self.status}")
        self.welcome = self.receive()
        self.input = 0

    def close(self):
        self.socket.close()

    def _fill(self):
        data = self.socket.recv(1 << 20)
        if not data:
            raise Closed("end of the stream")
        self.buffer += data
        self.bytes += len(data)

    def _send(self, opcode, payload):
        mask = os.urandom(4)
        length = len(payload)
        head = bytes([0x80 | opcode])
        if length < 126:
            head += bytes([0x80 | length])
        else:
            head += bytes([0xFE]) + struct.pack(">H", length) if length < 1 << 16 else bytes([0xFF]) + struct.pack(">Q", length)
        masked = bytes(b ^ mask[i & 3] for i, b in enumerate(payload))
        self.socket.sendall(head + mask + masked)

    def send(self, message):
        self._send(1, json.dumps(message).encode())

    def want(self, view, moving=False):
        """Asks for a view, stamped with time.monotonic() in milliseconds."""
        self.input += 1
        self.send({"type": "view", "input": self.input, "time": time.monotonic() * 1e3, "moving": moving, "view": view})
        return self.input

    def get(self, path, cookie=True):
        """(status, body) of a page beside the live view's."""
        page = http.client.HTTPConnection(self.at.hostname, self.at.port, timeout=30)
        page.request("GET", f"{self.at.path}{path}", headers={"Cookie": self.cookie} if cookie else {})
        answer = page.getresponse()
        body = answer.read()
        page.close()
        return answer.status, body

    def until(self, type_, seconds=30):
        """The next text of this type; frames and other texts are taken and dropped."""
        end = time.monotonic() + seconds
        while self.ready(end - time.monotonic()):
            got = self.receive()
            if isinstance(got, dict) and got["type"] == type_:
                return got
        raise TimeoutError(f"no {type_}")

    def ready(self, seconds):
        """Whether something is to be received within `seconds`."""
        return len(self.buffer) >= 2 or bool(select.select([self.socket], [], [], max(seconds, 0))[0])

    def receive(self):
        """The next message: an object, or a frame's (header, images), which is acknowledged."""
        while True:
            opcode, payload, final = self._message()
            if opcode == 8:
                raise Closed("closed by the server")
            if opcode == 9:
                self._send(10, payload)
                continue
            if opcode == 10:
                continue
            self.pieces += payload
            if opcode:
                self.kind = opcode
            if not final:
                continue
            whole, self.pieces = self.pieces, b""
            return json.loads(whole) if self.kind == 1 else self._frame(whole)

    def _message(self):
        while len(self.buffer) < 2:
            self._fill()
        first, length = self.buffer[0], self.buffer[1] & 127
        at = 2
        for size, form in ((126, ">H"), (127, ">Q")):
            if length == size:
                at = 2 + struct.calcsize(form)
                while len(self.buffer) < at:
                    self._fill()
                length = struct.unpack(form, self.buffer[2:at])[0]
                break
        while len(self.buffer) < at + length:
            self._fill()
        payload, self.buffer = self.buffer[at:at + length], self.buffer[at + length:]
        return first & 15, payload, bool(first & 0x80)

    def _frame(self, data):
        length = struct.unpack("<I", data[:4])[0]
        header = json.loads(data[4:4 + length])
        images, at = [], 4 + length
        for stripe in header["stripes"]:
            images.append(data[at:at + stripe["bytes"]])
            at += stripe["bytes"]
        if self.acknowledges:
            self.send({"type": "ack", "frame": header["frame"]})
        return header, images

    def until_exact(self, seconds=60):
        """The exact frame of the newest view."""
        end = time.monotonic() + seconds
        while self.ready(end - time.monotonic()):
            got = self.receive()
            if isinstance(got, tuple) and got[0]["exact"] and got[0]["input"] == self.input:
                return got
        raise TimeoutError("no exact frame")
