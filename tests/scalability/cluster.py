"""Clusters for the experiments: a master, voxel servers and workers, on loopback or each in a network namespace with its own
link and share of a processor."""
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time

BIN = pathlib.Path(os.environ.get("QUARRY_BIN", pathlib.Path(__file__).parents[2] / "build/release/bin"))


class Cluster:
    """The processes of a cluster; all end with the `with` block."""

    def __init__(self, store, place=None):
        self.store, self.place, self.processes = store, place, []
        self.folder = tempfile.TemporaryDirectory(prefix="quarry-cluster-")
        self.options, self.may_end = [], []
        if place:
            secret = pathlib.Path(self.folder.name) / "secret"
            secret.write_bytes(os.urandom(32).hex().encode())
            secret.chmod(0o600)
            self.options = ["--secret-file", str(secret)]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in reversed(self.processes):
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
        for process in self.processes:
            try:
                process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            process.stdout.close()
        self.folder.cleanup()

    def start(self, host, program, *arguments, options=None):
        """Starts a program at a host of the place, or on loopback without a place. Its log is in the cluster's folder."""
        command = [str(BIN / program), *map(str, arguments), *(self.options if options is None else options)]
        if self.place:
            command = self.place.command(host, command)
        log = open(pathlib.Path(self.folder.name) / f"{host}-{len(self.processes)}.log", "wb")
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
        log.close()
        if self.place:
            self.place.adopt(host, process)
        self.processes.append(process)
        return process

    def listen_at(self, host):
        return (self.place.address(host) if self.place else "127.0.0.1") + ":0"

    def server(self, host, *arguments):
        """Starts a master or a voxel server. Returns its address."""
        process = self.start(host, "quarry-master", self.store, "--listen", self.listen_at(host), *arguments)
        match = re.match(r"listening (\S+)", process.stdout.readline())
        if not match:
            raise RuntimeError(f"{host} does not listen: {self.logs()}")
        return match.group(1)

    def worker(self, host, master, *arguments):
        return self.start(host, "quarry-worker", "--master", master, "--name", host, "--threads", 1, *arguments)

    def await_workers(self, count):
        """Waits until `count` workers have joined, by the log of a master without --quiet."""
        joined = re.compile(rb"worker \S+ has joined")
        wait_for(lambda: sum(len(joined.findall(log.read_bytes())) for log in pathlib.Path(self.folder.name).glob("*.log")) >= count,
                 60, f"{count} workers")

    def render(self, host, master, output, stats, *arguments):
        """Renders a job. Returns the statistics of its frames."""
        process = self.start(host, "quarry", "render", self.store, "-o", output, "--master", master, "--stats", stats, "--quiet",
                             *arguments)
        while process.poll() is None:
            time.sleep(0.02)
            ended = [p for p in self.processes if p is not process and p.poll() is not None and p.returncode != 0
                     and p not in self.may_end]
            if ended:
                raise RuntimeError(f"a program has ended: {self.logs()}")
        if process.returncode != 0:
            raise RuntimeError(f"the render failed: {self.logs()}")
        return json.loads(pathlib.Path(stats).read_text())

    def logs(self):
        return "\n".join(path.name + ": " + path.read_text(errors="replace")[-800:]
                         for path in sorted(pathlib.Path(self.folder.name).glob("*.log")))


def info(store):
    return json.loads(subprocess.run([str(BIN / "quarry"), "info", store, "--json"], check=True, capture_output=True).stdout)


def end_s(frame):
    """Time of the end of a frame, in seconds."""
    return frame["frame_start_s"] + frame["frame_wall_s"]


def start_s(stats):
    """Time of the earliest start of a frame, in seconds."""
    return min(frame["frame_start_s"] for frame in stats["frames"])


def last_frame(stats):
    """The frame that ended last. Frames overlap, so it may not be the last of the path."""
    return max(stats["frames"], key=end_s)


def walk_s(stats):
    """Seconds from the earliest start of a frame to the last end."""
    return end_s(last_frame(stats)) - start_s(stats)


def received_bytes(stats):
    """Bytes of voxels that all workers received until the last end of a frame."""
    return sum(worker["voxel_bytes_received"] for worker in last_frame(stats)["workers"])


def path_of_frames(path, frames, output):
    """Writes a camera path of some frames of another. Returns `output`."""
    cameras = json.loads(pathlib.Path(path).read_text())
    cameras["frames"] = [cameras["frames"][f] for f in frames]
    pathlib.Path(output).write_text(json.dumps(cameras))
    return output


def processor_s(processes):
    """Seconds of processor time used by all processes together."""
    ticks = 0
    for process in processes:
        fields = pathlib.Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def read_tile_log(path):
    """Reads a file written by --trace. Returns (frames, tiles)."""
    frames, tiles = [], []
    for line in open(path):
        entry = json.loads(line)
        (tiles if "tile" in entry else frames).append(entry)
    return frames, tiles


def say(text):
    print(text, file=sys.stderr, flush=True)


def wait_for(condition, limit_s, what):
    end = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end:
            raise RuntimeError(f"{what}: not within {limit_s} s")
        time.sleep(0.05)
