"""The time of day as a program sees it, shifted by libfaketime; the monotonic clock runs on, as it does when a real one is set."""
import glob
import os

from stage import BIN

REAL_TIMERS = BIN / "quarry-test-real-timers.so"  # see real_timers.cpp


class Clock:
    """Programs started with `environment` read their time of day through `file`."""

    def __init__(self, file):
        self.file = file
        self.set(0)
        self.environment = {"LD_PRELOAD": f"{REAL_TIMERS}:{library()}", "FAKETIME_TIMESTAMP_FILE": file, "FAKETIME_NO_CACHE": "1",
                            "FAKETIME_DONT_FAKE_MONOTONIC": "1", "DONT_FAKE_MONOTONIC": "1"}

    def set(self, offset_s):
        temporary = self.file + ".new"
        with open(temporary, "w") as out:
            out.write(f"{offset_s:+d}s\n")
        os.replace(temporary, self.file)


def library():
    found = glob.glob("/usr/lib/*/faketime/libfaketimeMT.so.1")
    return found[0] if found else None


def why_not():
    """Why clocks cannot be shifted here, or None."""
    return None if library() else "libfaketime is not installed (deploy/install)"
