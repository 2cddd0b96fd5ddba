"""A viewer that moves while faults happen: it looks at another place ten times a second, and comes again whenever its connection ends."""
import json
import math
import pathlib
import sys
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[2]))
from tests.support.cluster.live_client import Closed, LiveClient

LOST = (Closed, OSError, TimeoutError, json.JSONDecodeError)  # errors of a connection to a master that is killed, stopped or out of reach
SIZE, TURN, PERIOD_S = [160, 120], 0.05, 0.1


class MovingViewer(threading.Thread):
    """Begins at once. `url`: with its token."""

    def __init__(self, url):
        super().__init__(daemon=True)
        self.url, self.frames, self.connections = url, 0, 0
        self.over = threading.Event()
        self.start()

    def run(self):
        while not self.over.is_set():
            try:
                self._watch()
            except LOST:
                time.sleep(PERIOD_S)

    def _watch(self):
        client = LiveClient(self.url, timeout=5)
        try:
            self.connections += 1
            step = 0
            while not self.over.is_set():
                client.want(self._view(client, step), moving=step % 20 < 15)
                step += 1
                end = time.monotonic() + PERIOD_S
                while client.ready(end - time.monotonic()):
                    self.frames += isinstance(client.receive(), tuple)
                    if time.monotonic() > end:
                        break
        finally:
            client.close()

    @staticmethod
    def _view(client, step):
        view = client.welcome["view"]
        camera = view["camera"]
        (x, y, z), (cx, cy, cz) = camera["eye"], camera["at"]
        turned = math.cos(TURN * step), math.sin(TURN * step)
        eye = [cx + turned[0] * (x - cx) - turned[1] * (y - cy), cy + turned[1] * (x - cx) + turned[0] * (y - cy), z]
        return {"camera": {**camera, "eye": eye}, "size": SIZE, "spp": 2, "mode": ("shadow", "ao", "raycast")[step // 20 % 3]}

    def end(self, seconds):
        """Ends the moving. Returns the fault; None when another viewer gets an exact picture within `seconds`."""
        self.over.set()
        self.join(10)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                client = LiveClient(self.url, timeout=5)
            except LOST:
                time.sleep(PERIOD_S)
                continue
            try:
                client.want(self._view(client, 3))
                client.until_exact(max(1, end - time.monotonic()))
                return "" if self.frames else "the viewer has seen no frame"
            except LOST:
                pass
            finally:
                client.close()
        return f"no viewer gets an exact picture within {seconds} s of the walk's end"
