"""A Slurm of several nodes on this machine: slurmctld, a slurmd for each node, munge, in a folder of their own."""
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import time

NODES = 4
PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "scontrol", "squeue", "scancel")


def find(program):
    return shutil.which(program, path=os.environ.get("PATH", "") + ":/usr/sbin:/sbin")


def why_not():
    """Why no Slurm can run here; None: it can."""
    missing = [p for p in PROGRAMS if not find(p)]
    if missing:
        return f"{', '.join(missing)} not found (deploy/install --tests installs them)"
    if os.geteuid() != 0:
        return "slurmd must be run by root"
    return None


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    ports = [s.getsockname()[1] for s in sockets]
    for s in sockets:
        s.close()
    return ports


class SlurmCluster:
    """Nodes n1 to n4. `environment`: the variables that Slurm's commands need."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.folder.mkdir(parents=True)
        (self.folder / "state").mkdir()
        self.programs, self.nodes = [], {}
        ports = free_ports(1 + NODES)
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o600)
        self.folder.chmod(0o755)
        self.conf = self.folder / "slurm.conf"
        nodes = "\n".join(f"NodeName=n{i + 1} NodeHostname=localhost NodeAddr=127.0.0.1 Port={ports[1 + i]} CPUs=1 RealMemory=2000"
                          for i in range(NODES))
        self.conf.write_text(f"""ClusterName=quarry
SlurmctldHost=localhost
SlurmctldPort={ports[0]}
AuthType=auth/munge
AuthInfo=socket={self.folder}/munge.socket
CredType=cred/munge
SlurmUser=root
SlurmdUser=root
StateSaveLocation={self.folder}/state
SlurmdSpoolDir={self.folder}/spool-%n
SlurmctldPidFile={self.folder}/slurmctld.pid
SlurmdPidFile={self.folder}/slurmd-%n.pid
SlurmctldLogFile={self.folder}/slurmctld.log
SlurmdLogFile={self.folder}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
MpiDefault=none
SwitchType=switch/none
MailProg=/bin/true
KillWait=5
MessageTimeout=5
SlurmdTimeout=5
MinJobAge=300
ReturnToService=2
SchedulerParameters=sched_interval=1,sched_min_interval=0,batch_sched_delay=0
{nodes}
PartitionName=main Nodes=n[1-{NODES}] Default=YES MaxTime=INFINITE State=UP
PartitionName=brief Nodes=n[1-{NODES}] MaxTime=1 State=UP
PartitionName=small Nodes=n[1-{NODES}] MaxNodes=1 State=UP
""")
        self.environment = dict(os.environ, SLURM_CONF=str(self.conf))

    def start(self):
        self._run("munged", "--foreground", "--force", f"--key-file={self.folder}/munge.key", f"--socket={self.folder}/munge.socket",
                  f"--pid-file={self.folder}/munged.pid", f"--log-file={self.folder}/munged.log", f"--seed-file={self.folder}/munged.seed")
        self._await(lambda: (self.folder / "munge.socket").exists(), "munged")
        self._run("slurmctld", "-D")
        for i in range(NODES):
            self.start_node(f"n{i + 1}")
        self._await(lambda: self.call("sinfo", "--noheader", "--states=idle", "--format=%D").stdout.strip() == str(NODES), "its nodes")

    def start_node(self, name):
        self.nodes[name] = self._run("slurmd", "-D", "-N", name)

    def kill_node(self, name):
        """All of a node's processes at once, as when its power fails: slurmd, the daemons of its steps, and their tasks."""
        for process in self.descendants(name):
            try:
                os.kill(process, signal.SIGKILL)
            except ProcessLookupError:
                pass
        self.nodes[name].wait()

    def descendants(self, name):
        """The processes of a node: by the name that Slurm gives their environment, or by their spool folder."""
        found = [self.nodes[name].pid]
        for entry in pathlib.Path("/proc").iterdir():
            if not entry.name.isdigit() or int(entry.name) == os.getpid():
                continue
            try:
                environment, line = (entry / "environ").read_bytes(), (entry / "cmdline").read_bytes()
            except OSError:
                continue
            mine = f"SLURM_CONF={self.conf}".encode() in environment.split(b"\0") or str(self.folder).encode() in line
            if mine and (f"SLURMD_NODENAME={name}".encode() in environment.split(b"\0") or
                         (line.startswith(b"slurmstepd") and self._stepd_node(int(entry.name)) == name)):
                found.append(int(entry.name))
        return found

    def _stepd_node(self, process):
        """The node of a slurmstepd: that of its children."""
        for task in pathlib.Path(f"/proc/{process}/task").iterdir():
            try:
                children = (task / "children").read_text().split()
            except OSError:
                continue
            for child in children:
                try:
                    for word in pathlib.Path(f"/proc/{child}/environ").read_bytes().split(b"\0"):
                        if word.startswith(b"SLURMD_NODENAME="):
                            return word[16:].decode()
                except OSError:
                    pass
        return None

    def call(self, program, *arguments, **options):
        return subprocess.run([find(program), *map(str, arguments)], capture_output=True, text=True, env=self.environment, timeout=60, **options)

    def states(self, job):
        """The states of a job and its tasks; empty once Slurm's queue has none."""
        return self.call("squeue", "--noheader", f"--jobs={job}", "--format=%T").stdout.split()

    def stop(self):
        self.call("scancel", "--user=root")
        deadline = time.monotonic() + 15
        while self.call("squeue", "--noheader").stdout and time.monotonic() < deadline:
            time.sleep(0.2)
        for process in reversed(self.programs):
            if process.poll() is None:
                process.terminate()
        for process in reversed(self.programs):
            try:
                process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _run(self, program, *arguments):
        log = open(self.folder / f"{program}-{len(self.programs)}.out", "wb")
        process = subprocess.Popen([find(program), *arguments], stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, env=self.environment,
                                   start_new_session=True)
        log.close()
        self.programs.append(process)
        return process

    def _await(self, condition, what):
        deadline = time.monotonic() + 30
        while not condition():
            if time.monotonic() > deadline:
                logs = "".join(p.read_text(errors="replace")[-2000:] for p in self.folder.glob("*.log"))
                raise RuntimeError(f"Slurm does not start: no {what}\n{logs}")
            time.sleep(0.1)
