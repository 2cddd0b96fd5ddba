"""The Debian packages on a bare Debian 12 root: they install, render the picture that the build renders, serve under systemd and in a container, and
go without a trace. The root and the packages it downloads are kept in the build folder, so that a second run is faster."""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.programs import BIN, PATIENCE, main

ROOT = pathlib.Path(__file__).parents[3]
BUILD = BIN.parent
KEPT = BUILD / "package-test"
TIMEOUT_S = 400 * PATIENCE
SCENE = ("plant", "--triangles", "50000")
PICTURE = ("--size", "320x240", "--mode", "whitted", "--quiet")
SECRET = "0123456789abcdef0123456789abcdef\n"


def run(*command, **options):
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=TIMEOUT_S, errors="replace", **options)


def must(*command, **options):
    done = run(*command, **options)
    if done.returncode != 0:
        raise AssertionError(f"{' '.join(map(str, command))}: {done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


def page_commands(folder):
    """The commands of the page of a folder of deploy/."""
    text = (ROOT / "deploy" / folder / "README.md").read_text()
    return [line.split("  #")[0].strip() for block in re.findall(r"```sh\n(.*?)```", text, re.S) for line in block.splitlines()]


def codename():
    return re.search(r"^VERSION_CODENAME=(\w+)", pathlib.Path("/etc/os-release").read_text(), re.M).group(1)


def mirror():
    """The archive that this machine's own apt takes Debian from; None: none is known."""
    listed = run("apt-get", "indextargets", "--format", "$(CODENAME) $(ORIGIN) $(COMPONENT) $(REPO_URI)", "Created-By: Packages").stdout
    found = re.search(rf"^{codename()} Debian main (\S+)$", listed, re.M)
    return found and found.group(1)


def bare_root():
    """A tar file of a bare Debian. Raises SkipTest where it is not to be had."""
    kept = KEPT / f"{codename()}.tar"
    if kept.exists():
        return kept
    archive = mirror()
    if not archive:
        raise unittest.SkipTest("apt names no archive of Debian")
    KEPT.mkdir(exist_ok=True)
    if shutil.which("mmdebstrap"):  # the same root in a third of the time
        made = run("mmdebstrap", "--variant=minbase", "--quiet", codename(), f"{kept}.part.tar", archive)
        if made.returncode != 0:
            raise unittest.SkipTest(f"mmdebstrap makes no root here: {made.stderr.strip().splitlines()[-1:]}")
        os.replace(f"{kept}.part.tar", kept)
        return kept
    with tempfile.TemporaryDirectory(prefix="quarry-test-") as folder:
        # Not the folder itself, which is closed to the users of the root's services.
        made = run("debootstrap", "--variant=minbase", codename(), f"{folder}/root", archive)
        if made.returncode != 0:
            raise unittest.SkipTest(f"debootstrap makes no root here: {(made.stdout + made.stderr).strip().splitlines()[-1:]}")
        must("tar", "-C", f"{folder}/root", "-cf", f"{kept}.part", ".")
    os.replace(f"{kept}.part", kept)
    return kept


class BareRoot:
    """A bare root with the package quarry and its dependencies, and the picture that the build renders."""

    def __init__(self, folder):
        self.folder, self.root, self.debs = folder, folder / "root", folder / "debs"
        self.root.mkdir()
        must("tar", "-C", self.root, "-xf", bare_root())
        # Downloads of apt are kept; and files are not flushed to the disk, which would take most of the time.
        (KEPT / "archives/partial").mkdir(parents=True, exist_ok=True)
        (self.root / "etc/apt/apt.conf.d/test").write_text(
            'APT::Keep-Downloaded-Packages "true";\nDpkg::Options:: "--force-unsafe-io";\nAcquire::Languages "none";\n'
            'APT::Get::Assume-Yes "true";\nAPT::Install-Recommends "false";\n')
        if self.inside("apt-get update -q").returncode != 0:
            raise unittest.SkipTest("the archive of Debian is out of reach")
        # gzip: of the packages that users get, half of the time goes into xz.
        pack, self.install, self.install_all, self.install_cad, self.install_library = page_commands("packages")
        must("sh", "-c", pack.replace("-B build/release", f"-D CPACK_DEBIAN_COMPRESSION_TYPE=gzip -B '{self.debs}'").replace("build/release", f"'{BUILD}'"))
        self.deb = {name: next(self.debs.glob(f"{name}_*.deb")).name for name in ("quarry", "quarry-bench", "libquarry0", "libquarry-dev", "python3-quarry", *["quarry-cad"] * (BIN / "quarry-import-cad").exists())}
        for name in self.deb.values():
            shutil.copy(self.debs / name, self.root / "root")
        # The packages that a machine needs for rendering, and no more.
        self.must(self.install)
        self.must(f"""quarry-scene {' '.join(SCENE)} -o m.ply --quiet; quarry-preprocess m.ply -o m.quarry --quiet
                      quarry render m.quarry -o inside.png {' '.join(PICTURE)} --workers 2""")
        self.store = self.root / "root/m.quarry"
        must(BIN / "quarry", "render", self.store, "-o", folder / "outside.png", *PICTURE)
        self.picture = (folder / "outside.png").read_bytes()

    def inside(self, script):
        """Runs a script in the root, in a process namespace of its own: nothing that it starts or mounts outlives it."""
        kept = KEPT / "archives"
        mounts = f"mount --bind '{kept}' '{self.root}/var/cache/apt/archives'; mount -t proc proc '{self.root}/proc'"
        return run("unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-ec", f"{mounts}; exec chroot '{self.root}' sh -ec \"$1\"", "sh",
                   f"cd /root; {script}", env={**os.environ, "DEBIAN_FRONTEND": "noninteractive", "HOME": "/root", "LC_ALL": "C.UTF-8",
                                             "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"}, stdin=subprocess.DEVNULL)

    def must(self, script):
        done = self.inside(script)
        if done.returncode != 0:
            raise AssertionError(f"{script}: {done.stdout[-2000:]}{done.stderr[-2000:]}")
        return done.stdout


bare = None


def setUpModule():
    global bare
    if os.geteuid() != 0 or not (shutil.which("mmdebstrap") or shutil.which("debootstrap")):
        raise unittest.SkipTest("a bare root needs root, and debootstrap or mmdebstrap")
    temporary = tempfile.TemporaryDirectory(prefix="quarry-test-")
    unittest.addModuleCleanup(temporary.cleanup)
    bare = BareRoot(pathlib.Path(temporary.name))


class Packages(unittest.TestCase):
    def test_a_bare_root_renders_the_picture_of_the_build(self):
        self.assertEqual((bare.root / "root/inside.png").read_bytes(), bare.picture)
        self.assertRegex(bare.must("quarry --version"), r"^quarry \d.*\n(.*\n)*instruction set: \w+")

    def test_libraries_are_named_and_rare_ones_recommended(self):
        field = lambda deb, name: must("dpkg-deb", "-f", bare.debs / bare.deb[deb], name)
        self.assertRegex(field("quarry", "Depends"), r"libssl3 .*libstdc\+\+6")
        self.assertNotRegex(field("quarry", "Depends"), "openimageio|assimp|draco|occt|embree")
        self.assertNotRegex(field("quarry", "Recommends"), "occt")
        if "quarry-cad" in bare.deb:
            self.assertRegex(field("quarry", "Recommends"), "quarry-cad")
            self.assertRegex(field("quarry-cad", "Depends"), r"libocct-data-exchange-7.6.* quarry \(= ")
        self.assertRegex(field("quarry", "Recommends"), "libopenimageio2.4")
        self.assertRegex(field("quarry-bench", "Depends"), r"libembree3-3 .*quarry \(= ")
        planned = bare.must(f"apt-get install -s -q --reinstall /root/{bare.deb['quarry']} && apt-get install -s -q libopenimageio2.4 libassimp5")
        self.assertRegex(planned, r"Inst libopenimageio2.4 ")

    def test_missing_packages_are_named(self):
        bare.must("""printf 'newmtl m\\nmap_Kd m.png\\n' > t.mtl; cp inside.png m.png
            printf 'mtllib t.mtl\\nv 0 0 0\\nv 1 0 0\\nv 0 1 0\\nvt 0 0\\nvt 1 0\\nvt 0 1\\nusemtl m\\nf 1/1 2/2 3/3\\n' > t.obj; printf 'AC3Db\\n' > x.ac""")
        for command, sentence in (("quarry-preprocess t.obj -o t.quarry", r"m\.png.*lacks shared libraries: install OpenImageIO .*libopenimageio2\.4.*--no-textures"),
                                  ("quarry-preprocess x.ac -o t.quarry", r"x\.ac: .*lacks shared libraries: install Assimp .*libassimp5"),
                                  ("quarry bench kernels", "quarry bench: no benchmark is installed: the package quarry-bench has them")):
            with self.subTest(command=command):
                done = bare.inside(command)
                self.assertEqual(done.returncode, 1)
                self.assertRegex(done.stderr.splitlines()[-1], sentence)
        bare.must("quarry-preprocess t.obj -o t.quarry --no-textures --quiet")

    def test_container(self):
        if not shutil.which("buildah"):
            self.skipTest("buildah is not installed")
        storage = bare.folder / "containers"
        buildah = ("buildah", "--root", storage / "root", "--runroot", storage / "run", "--storage-driver", "vfs")
        base = bare.folder / "base"
        base.mkdir()
        shutil.copy(bare_root(), base / "bare.tar")
        (base / "Containerfile").write_text("FROM scratch\nADD bare.tar /\n")
        must(*buildah, "bud", "--isolation", "chroot", "-t", "bare", base)
        # The page's command, with a base of our own and the folder that the packages are in.
        (line,) = page_commands("container")
        words = [bare.debs if word == "build/release" else word for word in line.split()[2:]]
        built = run(*buildah, "bud", "--isolation", "chroot", "--build-arg", "BASE=localhost/bare", *words, cwd=ROOT)
        self.assertEqual(built.returncode, 0, built.stdout[-2000:] + built.stderr[-2000:])
        container = must(*buildah, "from", "quarry").strip()
        work = bare.folder / "work"
        work.mkdir(mode=0o777)
        work.chmod(0o777)
        shutil.copy(bare.store, work / "m.quarry")
        bare.folder.chmod(0o755)
        inside = (*buildah, "run", "--isolation", "chroot", "-v", f"{work}:/work", container, "--")
        self.assertEqual(must(*inside, "id", "-u").strip(), "65532")
        must(*inside, "quarry", "render", "m.quarry", "-o", "p.png", *PICTURE)
        self.assertEqual((work / "p.png").read_bytes(), bare.picture)

    def test_compose_file_is_valid(self):
        if not shutil.which("docker-compose"):
            self.skipTest("docker-compose is not installed")
        # Checks the file by the schema of Compose.
        shown = must("docker-compose", "-f", ROOT / "deploy/container/compose.yaml", "config")
        self.assertRegex(shown, r"(?s)quarry-master.*quarry-worker")

    def test_programs_ask_rays(self):
        bare.must(bare.install_library)
        bare.must("apt-get install -q gcc g++ cmake make pkg-config")
        exported = bare.must("nm -D --defined-only $(ldconfig -p | sed -n 's/.*libquarry.so.0 .*=> //p') | sed 's/.* //; s/@.*//' | grep -v '^quarry_' || true")
        self.assertEqual(exported.strip(), "QUARRY_0")
        bare.must("cc -std=c99 -Wall -Wextra -Werror /usr/share/doc/libquarry-dev/examples/sight.c $(pkg-config --cflags --libs quarry) -o sight")
        bare.must("""mkdir -p by_cmake; printf 'cmake_minimum_required(VERSION 3.16)\nproject(s C CXX)\nfind_package(Quarry 0.1 REQUIRED)\n' > by_cmake/CMakeLists.txt
                     printf 'add_executable(sight /usr/share/doc/libquarry-dev/examples/sight.c)\ntarget_link_libraries(sight Quarry::quarry)\n' >> by_cmake/CMakeLists.txt
                     cmake -S by_cmake -B made && cmake --build made""")
        for sight in ("./sight", "made/sight"):
            self.assertRegex(bare.must(f"{sight} m.quarry 0 0 500 0 0 -500"), "^hidden by ")
            self.assertEqual(bare.must(f"{sight} m.quarry 0 0 500 10 0 500"), "in sight\n")
        said = bare.must("python3 /usr/share/doc/python3-quarry/examples/solar_hours.py m.quarry hours.ply --step 60")
        self.assertRegex(said, r"^\d+ points; sun for ")
        bare.must("apt-get purge -y -q libquarry0 libquarry-dev python3-quarry")

    def test_removal_leaves_nothing(self):
        bare.must(bare.install_all)
        self.assertRegex(bare.must("quarry bench plan --help"), "Usage")
        bare.must("quarry-scene cornell --triangles 1000 -o c.ply --quiet; quarry bench stores --help >/dev/null; touch /etc/quarry/secret")
        bare.must("apt-get purge -y -q quarry quarry-bench")
        left = bare.must("find / -xdev -name '*quarry*' -not -path '/root/*' -not -path '/proc/*' -not -path '/var/cache/apt/*'")
        self.assertEqual(left, "")
        bare.must(bare.install)


class Booted:
    """The root, booted by systemd-nspawn in namespaces of its own."""

    def __init__(self, root, log):
        self.log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(["systemd-nspawn", "--quiet", "--directory", root, "--register=no", "--keep-unit", "--private-network",
                                             "--console=read-only", "--boot"], stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT)
        children = pathlib.Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        self.leader = None
        until = time.monotonic() + 60 * PATIENCE
        while time.monotonic() < until and self.process.poll() is None:
            words = children.read_text().split()
            self.leader = words[0] if words else None
            if self.leader and self.run("systemctl is-system-running").stdout.strip() in ("running", "degraded"):
                return
            time.sleep(0.2)
        said = log.read_text(errors="replace").strip().splitlines()[-1:]
        self.end()
        raise unittest.SkipTest(f"systemd does not boot in a container here: {said}")

    def run(self, script):
        return run("nsenter", "--target", self.leader, "--all", "sh", "-ec", script, stdin=subprocess.DEVNULL)

    def end(self):
        if self.process.poll() is None and self.leader:
            self.run("systemctl --force poweroff")
        try:
            self.process.wait(timeout=30 * PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class Services(unittest.TestCase):
    """The units under a real systemd, in the root of the packages' test."""

    @classmethod
    def setUpClass(cls):
        if not shutil.which("systemd-nspawn"):
            raise unittest.SkipTest("systemd-nspawn is not installed")
        bare.must("apt-get install -q systemd systemd-sysv dbus openssl")
        root = bare.root
        (root / "srv/quarry").mkdir()
        shutil.copy(bare.store, root / "srv/quarry/scene.quarry")
        cls.booted = Booted(root, bare.folder / "boot.log")
        cls.addClassCleanup(cls.booted.end)

    def must(self, script):
        done = self.booted.run(script)
        self.assertEqual(done.returncode, 0, f"{script}: {done.stdout}{done.stderr}" + self.booted.run("journalctl -n 30 --no-pager").stdout)
        return done.stdout

    def test_master_and_workers_as_services(self):
        refused = self.booted.run("systemctl start quarry-master")
        self.assertNotEqual(refused.returncode, 0)
        self.assertRegex(self.must("systemctl show -p AssertResult quarry-master"), "no")
        # The page's commands. The start of each comes back when it serves, so that the next needs no wait.
        for command in page_commands("systemd"):
            self.must(command)
        self.must("systemctl start quarry-worker@2")
        self.assertIn("listening at 0.0.0.0:9000", self.must("systemctl show -p StatusText quarry-master"))
        # A user that exists while the service runs.
        self.assertGreater(int(self.must("stat -c %u /proc/$(systemctl show -p MainPID --value quarry-master)")), 60000)
        client = "cd /root; export QUARRY_MASTER=127.0.0.1:9000 QUARRY_SECRET_FILE=/etc/quarry/secret;"
        self.assertIn("workers: 2", self.must(f"{client} quarry status"))
        self.must(f"{client} quarry render -o service.png {' '.join(PICTURE)}")
        self.assertEqual((bare.root / "root/service.png").read_bytes(), bare.picture)
        # A master that is killed comes back, and its workers to it.
        self.must("systemctl kill --signal=KILL quarry-master")
        self.must("until systemctl is-active --quiet quarry-master; do sleep 0.2; done")
        self.must(f"{client} rm service.png; quarry render -o service.png {' '.join(PICTURE)}")
        self.assertEqual((bare.root / "root/service.png").read_bytes(), bare.picture)
        self.assertEqual(self.must("systemctl show -p NRestarts --value quarry-master").strip(), "1")
        self.must("systemctl stop quarry-worker@1 quarry-worker@2 quarry-master")
        states = self.must("systemctl show -p ActiveState --value quarry-worker@1 quarry-worker@2 quarry-master")
        self.assertEqual(states.split(), ["inactive"] * 3)

    def test_errors_are_in_the_journal(self):
        self.must(f"umask 077; printf '{SECRET}' > /etc/quarry/secret; echo QUARRY_SCENE=/srv/nosuch.quarry > /etc/quarry/master.conf")
        self.assertNotEqual(self.booted.run("systemctl start quarry-master").returncode, 0)
        self.assertIn("/srv/nosuch.quarry: cannot open", self.must("journalctl -u quarry-master --no-pager"))
        # Whichever test comes next finds the service as it was installed.
        self.must("systemctl stop quarry-master; rm /etc/quarry/secret; "
                  "printf 'QUARRY_SCENE=/srv/quarry/scene.quarry\\nQUARRY_LISTEN=0.0.0.0:9000\\n' > /etc/quarry/master.conf")


if __name__ == "__main__":
    main()
