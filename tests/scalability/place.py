"""Simulated machines on one machine. Each is a network namespace on a bridge, with a link of limited rate (tc tbf, both ways) and a
limited share of a processor (cgroup v1 or v2). Needs root."""
import itertools
import os
import pathlib
import shutil
import subprocess

PERIOD_US = 20000  # of the processor's limit: short, so that a share behaves like a slower processor


def why_not():
    """The reason why this machine cannot make a place, or None."""
    if os.geteuid() != 0:
        return "network namespaces and cgroups need root"
    if not shutil.which("ip") or not shutil.which("tc"):
        return "ip and tc (iproute2) are not installed"
    if not pathlib.Path("/sys/fs/cgroup/cpu").is_dir() and not pathlib.Path("/sys/fs/cgroup/cgroup.controllers").exists():
        return "no cgroup file system with a cpu controller"
    return None


def run(*command):
    subprocess.run(command, check=True, capture_output=True)


class Place:
    """The hosts, by name; make() adds a host. All end with the `with` block."""

    made = itertools.count()

    def __init__(self):
        # Each name is new, since the kernel removes old devices with a delay.
        self.name = f"qy{os.getpid() % 10000}p{next(self.made)}"
        self.bridge, self.hosts, self.spaces = self.name + "b", {}, []
        self.v1 = pathlib.Path("/sys/fs/cgroup/cpu")
        self.v2 = pathlib.Path("/sys/fs/cgroup")

    def __enter__(self):
        run("ip", "link", "add", self.bridge, "type", "bridge")
        run("ip", "link", "set", self.bridge, "up")
        return self

    def __exit__(self, *_):
        for space in self.spaces:
            subprocess.run(["ip", "netns", "del", space], capture_output=True)
        for host in self.hosts.values():
            try:
                host["group"].rmdir()
            except OSError:
                pass
        subprocess.run(["ip", "link", "del", self.bridge], capture_output=True)

    def make(self, name, mbit, share=None):
        """Makes a host with a link of `mbit` and, if given, `share` of a processor."""
        number = len(self.hosts) + 1
        space, outside, inside = f"{self.name}n{number}", f"{self.name}v{number}", f"{self.name}w{number}"
        address = f"10.77.{os.getpid() % 250}.{number}"
        run("ip", "netns", "add", space)
        self.spaces.append(space)
        run("ip", "link", "add", outside, "type", "veth", "peer", "name", inside)
        run("ip", "link", "set", inside, "netns", space)
        run("ip", "link", "set", outside, "master", self.bridge)
        run("ip", "link", "set", outside, "up")
        run("ip", "-n", space, "addr", "add", f"{address}/24", "dev", inside)
        run("ip", "-n", space, "link", "set", inside, "up")
        run("ip", "-n", space, "link", "set", "lo", "up")
        # A burst of a few milliseconds; packets that wait longer than 100 ms are dropped, as by a switch.
        burst = max(65536, int(mbit * 1e6 / 8 * 0.002))
        limit = ["tbf", "rate", f"{mbit}mbit", "burst", str(burst), "latency", "100ms"]
        run("tc", "qdisc", "add", "dev", outside, "root", *limit)
        run("ip", "netns", "exec", space, "tc", "qdisc", "add", "dev", inside, "root", *limit)
        self.hosts[name] = {"space": space, "address": address, "number": number, "limited": share is not None,
                            "group": self.limit(f"{self.name}-{number}", share)}

    def limit(self, name, share):
        """Makes a cgroup with precedence over other programs of this machine, so that a host gets exactly its share."""
        v1 = self.v1.is_dir()
        group = (self.v1 if v1 else self.v2) / name
        if not v1:
            (self.v2 / "cgroup.subtree_control").write_text("+cpu")
        group.mkdir()
        (group / ("cpu.shares" if v1 else "cpu.weight")).write_text(str(100000 if v1 else 9000))
        if share is not None and v1:
            (group / "cpu.cfs_period_us").write_text(str(PERIOD_US))
            (group / "cpu.cfs_quota_us").write_text(str(int(PERIOD_US * share)))
        elif share is not None:
            (group / "cpu.max").write_text(f"{int(PERIOD_US * share)} {PERIOD_US}")
        return group

    def address(self, name):
        return self.hosts[name]["address"]

    def command(self, name, command):
        """The command for running at the host: in its namespace and, from its first instruction, in its cgroup."""
        host = self.hosts[name]
        inside = ["ip", "netns", "exec", host["space"], *command]
        # A limited host runs on one processor: the kernel divides a limit into slices per processor, and a slice that a
        # processor does not use is lost.
        processors = str(host["number"] % os.cpu_count()) if host["limited"] else f"0-{os.cpu_count() - 1}"
        # The group is entered first, since a namespace has another /sys.
        return ["sh", "-c", f'echo $$ > {host["group"]}/cgroup.procs && exec taskset -c {processors} "$@"', "sh", *inside]

    def adopt(self, name, process):
        """Does nothing: the process enters its group itself."""
