"""The README's own commands, as a stranger would type them: every line of its shell blocks is run, in order, by one shell in one copy of the
project. Commands that run until Ctrl-C are started, looked at, and ended so. By default the copy has this build's programs;
with QUARRY_README_WHOLE=1 it is a fresh clone, in which deploy/quickstart installs and builds first (10 minutes and more)."""
import os
import pathlib
import re
import signal
import subprocess
import sys
import urllib.request

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, PATIENCE, TIMEOUT_S, Case, end, main

ROOT = pathlib.Path(__file__).parents[3]
WHOLE = os.environ.get("QUARRY_README_WHOLE") == "1"
LASTING = ("quarry view", "quarry master", "quarry worker")  # until Ctrl-C
BUILD_S = 3600 * PATIENCE


def shell_lines():
    """The lines of the README's shell blocks, without their comments."""
    text = (ROOT / "README.md").read_text()
    lines = [line.split(" #")[0].strip() for block in re.findall(r"```sh\n(.*?)```", text, re.S) for line in block.splitlines()]
    return [line for line in lines if line and not line.startswith("deploy/test")]


class Readme(Case):
    def project(self):
        """The copy of the project to work in."""
        copy = self.folder / "quarry"
        if WHOLE:
            subprocess.run(["git", "clone", "-q", str(ROOT), str(copy)], check=True)
        else:
            (copy / "build/release").mkdir(parents=True)
            (copy / "build/release/bin").symlink_to(BIN)
        return copy

    def run_line(self, line, copy, path, timeout_s=TIMEOUT_S):
        done = subprocess.run(["bash", "-c", line], cwd=copy, env={**os.environ, "PATH": path}, capture_output=True, text=True, timeout=timeout_s)
        self.assertEqual(done.returncode, 0, f"{line}: {done.stdout[-2000:]}{done.stderr[-2000:]}")
        return done

    def start_line(self, line, copy, path):
        environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "BROWSER")}
        process = subprocess.Popen(["bash", "-c", "exec " + line], cwd=copy, env={**environment, "PATH": path, "XDG_STATE_HOME": str(self.folder / "state")},
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, process)
        return process

    def look_at_page(self, view):
        """The page behind the address that `quarry view` prints opens."""
        address = view.stdout.readline().strip()
        with urllib.request.build_opener(urllib.request.HTTPCookieProcessor()).open(address, timeout=TIMEOUT_S) as answer:
            self.assertEqual(answer.status, 200)
            self.assertIn("<title>", answer.read().decode())
        view.send_signal(signal.SIGINT)
        self.assertIn("shows it again", view.communicate(timeout=TIMEOUT_S)[1])

    def test_its_commands_work_as_described(self):
        copy, path, lasting = self.project(), os.environ["PATH"], []
        lines = shell_lines()
        self.assertGreaterEqual(len(lines), 12)
        for line in lines:
            with self.subTest(command=line):
                if line.startswith("deploy/quickstart"):
                    if not WHOLE:
                        continue
                    last = self.run_line(line, copy, path, BUILD_S).stdout.rstrip().splitlines()[-1]
                    self.look_at_page(self.start_line(last.strip(), copy, path))
                elif line.startswith("export PATH="):
                    path = self.run_line(f"{line}; printf %s \"$PATH\"", copy, path).stdout
                elif "quarry view" in line:
                    if WHOLE or "quickstart" not in line:
                        self.look_at_page(self.start_line(line, copy, path))
                elif line.startswith(LASTING):
                    lasting.append(self.start_line(line, copy, path))
                    if "master" in line.split()[1]:
                        self.assertTrue(lasting[-1].stdout.readline().startswith("listening"))
                else:
                    self.run_line(line, copy, path)
        self.assertEqual([process.poll() for process in lasting], [None, None])
        for picture in ("plant.png", "inside.png", "walk.0054.png", "walk.0057.png"):
            self.assertGreater((copy / "build" / picture).stat().st_size, 20000)

    def test_files_it_names_are_there(self):
        text = (ROOT / "README.md").read_text()
        for name in re.findall(r"\]\(([^)]+)\)", text) + re.findall(r"`((?:tests|deploy)/[\w/.]+)`", text):
            if not name.startswith("https://"):
                self.assertTrue((ROOT / name).exists(), name)

    def test_help_has_examples(self):
        for program in ("quarry", "quarry-master", "quarry-worker", "quarry-preprocess", "quarry-scene"):
            with self.subTest(program=program):
                done = self.must(program, "--help")
                self.assertRegex(done.stdout, r"Example")


if __name__ == "__main__":
    main()
