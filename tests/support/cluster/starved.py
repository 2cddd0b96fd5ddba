"""Workers with a share of a core, by a cgroup (v1, root), to starve a live view."""
import contextlib
import os
import pathlib

FOLDER = pathlib.Path("/sys/fs/cgroup/cpu")


def why_not_starved():
    """Why this machine cannot give processes a share of a core; None: it can."""
    if os.geteuid() != 0:
        return "needs root"
    return None if (FOLDER / "cpu.cfs_quota_us").exists() or (FOLDER / "cgroup.procs").exists() else "needs cgroup v1 with cpu"


class Starved:
    """A cgroup of processes that have a share of a core together."""

    PERIOD_US = 100000

    def __init__(self, share, processes):
        self.folder = FOLDER / f"quarry-starved-{os.getpid()}"
        self.folder.mkdir()
        (self.folder / "cpu.cfs_period_us").write_text(str(self.PERIOD_US))
        (self.folder / "cpu.cfs_quota_us").write_text(str(int(share * self.PERIOD_US)))
        for process in processes:
            (self.folder / "cgroup.procs").write_text(str(process))

    def end(self):
        for process in (self.folder / "cgroup.procs").read_text().split():
            with contextlib.suppress(OSError):
                (self.folder.parent / "cgroup.procs").write_text(process)
        self.folder.rmdir()


def is_whole(header):
    """Whether each square of a frame's lattice has a pixel that is traced or waits for a block."""
    width, height = header["size"]
    points = -(-width // header["step"]) * -(-height // header["step"])
    return round(header["traced"] * width * height) + header["waiting"] >= points
