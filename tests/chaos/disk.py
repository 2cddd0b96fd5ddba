"""A small disk of its own for a folder, that can be filled up."""
import asyncio
import contextlib
import os
import subprocess


class Disk:
    def __init__(self, folder, size):
        self.folder = folder
        os.makedirs(folder)
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "quarry-chaos", folder], check=True, capture_output=True)

    @contextlib.asynccontextmanager
    async def full(self):
        ballast = os.path.join(self.folder, "ballast")
        filling = asyncio.create_task(self._fill(ballast))
        try:
            yield
        finally:
            filling.cancel()
            await asyncio.gather(filling, return_exceptions=True)
            with contextlib.suppress(FileNotFoundError):
                os.remove(ballast)

    @staticmethod
    async def _fill(path):
        """And keeps it full, whatever is deleted meanwhile."""
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        try:
            while True:
                with contextlib.suppress(OSError):
                    while True:
                        os.write(fd, bytes(4096))
                await asyncio.sleep(0.05)
        finally:
            os.close(fd)

    def close(self):
        subprocess.run(["umount", "-l", self.folder], check=False, capture_output=True)


def why_not():
    """Why disks cannot be made here, or None."""
    return None if os.geteuid() == 0 and os.access("/proc/self/ns/mnt", os.R_OK) and _can_mount() else "it needs root to mount a tmpfs"


def _can_mount():
    import tempfile
    with tempfile.TemporaryDirectory() as folder:
        if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4K", "quarry-chaos", folder], capture_output=True).returncode:
            return False
        subprocess.run(["umount", folder], check=True)
        return True
