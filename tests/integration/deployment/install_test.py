"""cmake --install into a folder: programs, helpers, man pages, completion and units work from there, wherever it is moved to."""
import os
import pathlib
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, TIMEOUT_S, Case, end, main

ROOT = pathlib.Path(__file__).parents[3]
PROGRAMS = ("quarry", "quarry-master", "quarry-worker", "quarry-preprocess", "quarry-scene")
MIB = 1 << 20


def run(*command, **options):
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=TIMEOUT_S, **options)


class Installation(unittest.TestCase):
    """Tests an installation in a folder."""

    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory(prefix="quarry-test-")
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = pathlib.Path(temporary.name)
        # A folder with a space, moved after the installation: nothing may remember where it was.
        first, cls.prefix = cls.folder / "first", cls.folder / "moved here"
        done = run("cmake", "--install", BIN.parent, "--prefix", first, "--strip")
        if done.returncode != 0:
            raise RuntimeError(done.stderr)
        first.rename(cls.prefix)
        os.environ["QUARRY_CACHE_DIR"] = str(cls.folder / "cache")

    def must(self, program, *arguments, **options):
        done = run(self.prefix / "bin" / program, *arguments, **options)
        self.assertEqual(done.returncode, 0, f"{program} {arguments}: {done.stderr}")
        return done.stdout


class Programs(Installation):
    def test_programs_and_helpers_find_each_other(self):
        image = self.folder / "red.png"
        quad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3 4/4\n"
        (self.folder / "plain.obj").write_text(quad)
        self.must("quarry", "render", self.folder / "plain.obj", "-o", image, "--size", "8x8", "--quiet")
        (self.folder / "m.mtl").write_text("newmtl m\nmap_Kd red.png\n")
        (self.folder / "m.obj").write_text("mtllib m.mtl\n" + quad)
        self.must("quarry-preprocess", self.folder / "m.obj", "-o", self.folder / "m.quarry", "--quiet")
        self.assertIn("red.png", self.must("quarry", "info", self.folder / "m.quarry", "--textures"))
        if (BIN / "quarry-import-assimp").exists():
            (self.folder / "m.ac").write_text(
                'AC3Db\nMATERIAL "m" rgb 1 1 1 amb 1 1 1 emis 0 0 0 spec 0 0 0 shi 0 trans 0\nOBJECT world\nkids 1\nOBJECT poly\nname "q"\n'
                "numvert 3\n0 0 0\n1 0 0\n0 1 0\nnumsurf 1\nSURF 0x20\nmat 0\nrefs 3\n0 0 0\n1 0 0\n2 0 0\nkids 0\n")
            self.must("quarry-preprocess", self.folder / "m.ac", "-o", self.folder / "ac.quarry", "--quiet")

    def test_benchmarks_are_found_or_their_package_is_named(self):
        self.assertIn("kernels", run(self.prefix / "bin/quarry", "bench", "--help").stdout)
        self.assertRegex(self.must("quarry", "bench", "connection", "--help"), "Usage")
        alone = self.folder / "alone"
        alone.mkdir()
        shutil.copy(self.prefix / "bin/quarry", alone)
        for arguments in (["kernels"], ["nosuch"]):
            done = run(alone / "quarry", "bench", *arguments)
            self.assertEqual(done.returncode, 1)
            self.assertRegex(done.stderr, r"^quarry bench: no benchmark is installed: the package quarry-bench has them.*\n$")

    def test_the_version_describes_the_build(self):
        release = re.search(r'kVersion = "([^"]+)"', (ROOT / "common/base/version.h").read_text()).group(1)
        for program in PROGRAMS:
            with self.subTest(program=program):
                text = self.must(program, "--version")
                self.assertEqual(text.splitlines()[0], f"{program} {release}")
                self.assertRegex(text, r"\nbuild: \w+ [\d.]+, \w+, x86-64-v3")
                self.assertRegex(text, r"\nlibraries: Boost [\d.]+ .*libfmt \d")
        scalar = self.must("quarry-worker", "--version", env={**os.environ, "QUARRY_ISA": "scalar"})
        self.assertIn("\ninstruction set: scalar\n", scalar)
        self.assertRegex(scalar, r"libraries: .*liblz4 1\.\d.*OpenSSL 3\.\d")

    def test_each_command_has_a_man_page(self):
        pages = self.prefix / "share/man/man1"
        if not pages.exists() or not shutil.which("man"):
            self.skipTest("help2man or man is not installed")
        commands = [[program] for program in PROGRAMS] + [["quarry", name] for name in
                                                          ("render", "view", "info", "verify", "status", "cache", "cluster", "bench")]
        for command in commands:
            with self.subTest(command=command):
                page = pages / ("-".join(command) + ".1.gz")
                shown = run("man", "--warnings", "-l", page, env={**os.environ, "MANWIDTH": "2000", "LC_ALL": "C.UTF-8", "MAN_KEEP_FORMATTING": ""})
                self.assertEqual((shown.returncode, shown.stderr), (0, ""))
                text = shown.stdout
                self.assertRegex(text, rf"NAME\n +{'-'.join(command)} - \w")
                for section in ("SYNOPSIS", "EXIT STATUS", "SEE ALSO"):
                    self.assertIn(f"\n{section}\n", text)
                if command != ["quarry", "bench"]:
                    for option in re.findall(r"^  (?:-\w,)?(--[\w-]+)", self.must(*command, "--help"), re.M):
                        self.assertIn(option, text.replace("\u2010", "-"))

    def test_bash_completes_commands_options_and_values(self):
        library = pathlib.Path("/usr/share/bash-completion/bash_completion")
        if not library.exists():
            self.skipTest("bash-completion is not installed")
        folder = self.prefix / "share/bash-completion/completions"
        for program in PROGRAMS:
            self.assertTrue((folder / program).exists(), program)
        script = f"""
            source {library}; source '{folder}/quarry'; PATH="{self.prefix}/bin:$PATH"
            while IFS= read -r line; do
              COMP_LINE=$line COMP_POINT=${{#line}}; read -ra COMP_WORDS <<<"$line"
              [[ $line == *' ' ]] && COMP_WORDS+=("")
              COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)) COMPREPLY=()
              _quarry; echo "${{COMPREPLY[*]}}"
            done"""
        expected = {
            "quarry re": "render",
            "quarry render --mod": "--mode",
            "quarry render x.ply --mode wh": "whitted",
            "quarry render --aov depth,nor": "depth,normal",
            "quarry cache ": "list add limit clear",
            "quarry bench ker": "kernels",
            "quarry-scene pl": "plant",
            "quarry-scene plant --tri": "--triangles",
            "quarry-worker --peers ": "auto off",
            "quarry-preprocess --vers": "--version",
        }
        done = run("bash", "-c", script, input="\n".join(expected) + "\n")
        self.assertEqual(dict(zip(expected, done.stdout.splitlines())), expected, done.stderr)


class Services(Installation):
    def unit(self, name):
        return self.prefix / "lib/systemd/system" / name

    def test_units_are_sound_and_little_exposed(self):
        if not shutil.which("systemd-analyze"):
            self.skipTest("systemd is not installed")
        # Units hold the prefix, in which there may be no space.
        prefix = self.folder / "units"
        done = run("cmake", "--install", BIN.parent, "--prefix", prefix, "--component", "services")
        self.assertEqual(done.returncode, 0, done.stderr)
        (prefix / "bin").symlink_to(self.prefix / "bin")
        for name in ("quarry-master.service", "quarry-worker@.service"):
            unit = prefix / "lib/systemd/system" / name
            with self.subTest(unit=name):
                verified = run("systemd-analyze", "verify", "--man=no", unit)
                self.assertEqual((verified.returncode, verified.stderr), (0, ""))
                # In tenths: the remaining exposure is the network, which the services need.
                exposed = run("systemd-analyze", "security", "--offline=yes", "--threshold=15", unit)
                self.assertEqual(exposed.returncode, 0, exposed.stdout + exposed.stderr)

    def test_memory_of_the_worker_s_unit_is_its_ceiling(self):
        settings = (self.prefix / "etc/quarry/worker.conf").read_text()
        unit = self.unit("quarry-worker@.service").read_text()
        cache = int(re.search(r"^QUARRY_CACHE=(\d+)G$", settings, re.M).group(1)) * 1024 * MIB
        limit = int(re.search(r"^MemoryMax=(\d+)M$", unit, re.M).group(1)) * MIB
        ceiling = cache + 24 * MIB + 64 * 4 * MIB + 50000 * 400 + 6 * MIB
        self.assertGreaterEqual(limit, ceiling)
        self.assertLess(limit, 1.1 * ceiling)

    def test_a_person_s_settings_are_kept(self):
        settings = self.prefix / "etc/quarry/master.conf"
        settings.write_text("QUARRY_SCENE=mine\n")
        done = run("cmake", "--install", BIN.parent, "--prefix", self.prefix, "--component", "services")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(settings.read_text(), "QUARRY_SCENE=mine\n")


class Readiness(Case):
    """Demands of systemd's Type=notify and LoadCredential= on a program."""

    def test_master_and_worker_say_when_they_are_ready(self):
        store = self.store("cornell", 1000)
        for kind in ("path", "abstract"):
            with self.subTest(kind=kind):
                address = self.path("notify") if kind == "path" else f"@quarry-test-{os.getpid()}"
                manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
                self.addCleanup(manager.close)
                manager.bind(address.replace("@", "\0"))
                manager.settimeout(TIMEOUT_S)
                os.environ["NOTIFY_SOCKET"] = address
                self.addCleanup(os.environ.pop, "NOTIFY_SOCKET", None)
                _, master = self.start_master(store)
                self.assertEqual(manager.recv(4096).decode(), f"READY=1\nSTATUS=listening at {master}")
                self.start_worker(master)
                self.assertEqual(manager.recv(4096).decode(), f"READY=1\nSTATUS=has joined the master at {master}")

    def test_a_missing_service_manager_is_no_error(self):
        store = self.store("cornell", 1000)
        for address in ("/nosuch/socket", "", "@", "/" + "x" * 200, "vsock:2:1"):
            os.environ["NOTIFY_SOCKET"] = address
            self.addCleanup(os.environ.pop, "NOTIFY_SOCKET", None)
            master, _ = self.start_master(store)
            end(master)

    def test_credentials_that_an_access_list_opens_to_the_service(self):
        store = self.store("cornell", 1000)
        secret = self.folder / "secret"
        secret.write_text("0123456789abcdef0123456789abcdef\n")
        command = ["quarry-master", store, "--listen", "nosuch.invalid:1", "--secret-file", secret]
        for folder, mode, trusted in ((self.folder, 0o400, True), (self.folder, 0o440, True), (self.folder, 0o444, False), (self.folder, 0o460, False),
                                      (self.folder / "other", 0o440, False), (None, 0o440, False)):
            with self.subTest(folder=folder, mode=oct(mode)):
                secret.chmod(mode)
                environment = {**os.environ, **({"CREDENTIALS_DIRECTORY": str(folder)} if folder else {})}
                # A trusted secret is read; then the address fails.
                done = self.run_program(*command, env=environment)
                self.assertNotEqual(done.returncode, 0)
                self.assertEqual("users other than its owner may read this secret" not in done.stderr, trusted, done.stderr)


if __name__ == "__main__":
    main()
