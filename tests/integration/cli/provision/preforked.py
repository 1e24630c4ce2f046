"""`provision` and Ansible without their imports: a process that has imported what they need forks a child for each run.

A child is what the program would be: a process of its own with the arguments, environment, folder, network, standard
streams and passed descriptors of its caller, in which `main` of the program runs and Python ends as it always does.
What it has imported is the only difference. Ansible reads its settings when it is imported: the process that serves
`provision` has not imported it, and those that serve Ansible have one set of settings each (`_settings`). The programs
themselves are started by the tests of their start, by those that kill them, and once for each command that is typed.
The emulated routers of a rehearsal are forked from the same process. A shell reaches it by preforked_client.py.
"""

import atexit
import ctypes
import fcntl
import gc
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import asdict, dataclass, field
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, TextIO, cast

from atlantis_netcfg.core.paths import write_private
from atlantis_netcfg.emulator.routeros import SiteSpec, SpawnedSite

CHECKOUT = Path(__file__).resolve().parents[4]
PLAYBOOK = str(Path(sys.executable).with_name("ansible-playbook"))
PRELOADED = (
    *("atlantis_netcfg.cli", "atlantis_netcfg.emulator.routeros.__main__"),
    *("atlantis_netcfg.cli.base.output", "atlantis_netcfg.cli.base.syntax", "atlantis_netcfg.cli.base.playbook"),
    *("atlantis_netcfg.cli.base.session", "atlantis_netcfg.cli.devices", "atlantis_netcfg.cli.runs"),
    *(
        "atlantis_netcfg.operations.common.jobs",
        "atlantis_netcfg.operations.common.rehearsal",
        "atlantis_netcfg.operations.restore",
    ),
    *(
        "atlantis_netcfg.operations.common.terminals",
        "atlantis_netcfg.operations.apply",
    ),
    *("atlantis_netcfg.operations.common.vault", "atlantis_netcfg.runs.report.drift", "atlantis_netcfg.routeros.fleet"),
    *("cryptography.hazmat.primitives.kdf.pbkdf2", "cryptography.x509", "jinja2.nativetypes", "jinja2.sandbox"),
    *("multiprocessing.queues", "multiprocessing.shared_memory", "multiprocessing.synchronize", "packaging.tags"),
    *("curses", "pprint", "pty", "syslog", "tarfile", "xml.dom.minidom", "xml.etree.ElementTree", "yaml"),
)
"""What most commands import; no more than that, so that a command which forgets an import still fails."""
_PLUGINS = "atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins"
ANSIBLE = (
    *("ansible.cli.adhoc", "ansible.cli.playbook", "ansible.plugins.become.sudo", "ansible.plugins.callback.default"),
    *("ansible.plugins.connection.ssh", "ansible.plugins.filter.core", "ansible.plugins.shell.sh"),
    *("ansible.plugins.strategy.linear", "ansible.plugins.test.core"),
    *(f"ansible.plugins.callback.{name}" for name in ("junit", "minimal", "oneline", "tree")),
    *("ansible.plugins.become.su", "ansible.plugins.cache.memory", "ansible.plugins.vars.host_group_vars"),
    *("ansible.plugins.inventory.host_list", "ansible.plugins.inventory.yaml"),
    *(f"{_PLUGINS}.plugin_utils.{name}" for name in ("engine_action", "zipapp_action")),
    *(f"{_PLUGINS}.modules.{name}" for name in ("build", "clock", "configure", "env_conflicts", "packages")),
    *(
        "atlantis_netcfg.computers.bundle.open",
        "atlantis_netcfg.core.processes.remote_bundle",
        "atlantis_netcfg.operations.common.request",
    ),
    *("atlantis_netcfg.operations.computers._watch", "atlantis_netcfg.operations.computers.desired_state"),
)
"""What Ansible imports for a role of the gateways, in itself or in each of its tasks."""
_NEW_NETWORK = 0x40000000
"""CLONE_NEWNET, see unshare(2)."""
_CONFIGURATION = "_CONFIGURATION"
"""In the environment of a process that serves Ansible: the text of its configuration, which makes the key complete."""
_NEW_MOUNTS = 0x00020000
"""CLONE_NEWNS."""
_HIGH = 500
"""Descriptors from here on are in nobody's way while a child puts its own in their places."""
_CHILDREN = 900
"""The descriptor by which a child reaches the prepared process, to start emulated routers."""


class Process:
    """What was started: the few words of `subprocess.Popen` that its callers use."""

    def __init__(self, ours: socket.socket) -> None:
        self._ours = ours
        self._code: int | None = None
        self.stdin: TextIO | None = None
        self.stdout: TextIO | None = None

    def wait(self, timeout: float | None = None) -> int:
        """Give its exit code. Raises TimeoutExpired."""
        if self._code is None:
            self._ours.settimeout(timeout)
            try:
                self._code = int(self._ours.recv(16))
            except TimeoutError as late:
                raise subprocess.TimeoutExpired("a process of preforked.py", timeout or 0) from late
            self._ours.close()
        return self._code

    def kill(self) -> None:
        """End it, if it has not ended."""
        with suppress(OSError):
            self._ours.shutdown(socket.SHUT_WR)


def run(  # noqa: PLR0913 - as subprocess.run has them
    arguments: Sequence[str],
    *,
    env: Mapping[str, str],
    stdin: int = subprocess.DEVNULL,
    stderr: int = subprocess.PIPE,
    pass_fds: Sequence[int] = (),
    module: str = "atlantis_netcfg.cli",
    folder: Path | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a command line of `provision`, or of another module; as `subprocess.run` with `capture_output` does."""
    with ExitStack() as stack, ExitStack() as theirs:
        readers, writers = [], []
        for _ in range(1 if stderr == subprocess.STDOUT else 2):
            reader, writer = os.pipe()
            readers.append(stack.enter_context(os.fdopen(reader, "rb")))
            writers.append(theirs.enter_context(os.fdopen(writer, "wb")).fileno())
        if stdin == subprocess.DEVNULL:
            stdin = theirs.enter_context(Path(os.devnull).open("rb")).fileno()
        process = _start(
            _Request(module, list(arguments), dict(env), list(pass_fds), folder=str(folder or Path.cwd())),
            *(stdin, writers[0], writers[-1]),
        )
        stack.callback(process.kill)
        theirs.close()
        printed = _read_all(readers)
        status = process.wait()
    return subprocess.CompletedProcess(["provision", *arguments], status, *printed)


def start(arguments: Sequence[str], env: Mapping[str, str], terminal: int, folder: Path) -> Process:
    """Start a command line in a folder; its standard streams are all a terminal."""
    request = _Request("atlantis_netcfg.cli", list(arguments), dict(env), folder=str(folder))
    return _start(request, terminal, terminal, terminal)


def ansible(  # noqa: PLR0913 - as subprocess.run has them
    program: str,
    arguments: Sequence[str],
    *,
    env: Mapping[str, str],
    folder: Path,
    output: int,
    errors: int | None = None,
    pass_fds: Sequence[int] = (),
) -> Process:
    """Start `ansible-playbook` or `ansible`, by its path; `output` also takes the errors if they have no place."""
    module = f"ansible.cli.{'playbook' if program.endswith('-playbook') else 'adhoc'}"
    with Path(os.devnull).open("rb") as nothing:
        request = _Request(module, list(arguments), dict(env), list(pass_fds), folder=str(folder), program=program)
        return _start(request, nothing.fileno(), output, output if errors is None else errors, settings=_settings(env))


def play(arguments: Sequence[str], folder: Path, *, pass_fds: Sequence[int] = ()) -> Process:
    """Start `ansible-playbook` with our settings in a folder, in which its home is and `said`, all that it says."""
    env = os.environ | settings(folder)
    with (folder / "said").open("w") as said:
        return ansible(PLAYBOOK, arguments, env=env, folder=folder, output=said.fileno(), pass_fds=pass_fds)


def settings(folder: Path) -> dict[str, str]:
    """What Ansible finds in its environment: our settings, and its home in a folder."""
    return {"ANSIBLE_CONFIG": str(CHECKOUT / "ansible.cfg"), "ANSIBLE_HOME": str(folder / "ansible")}


def spawn(spec: SiteSpec, state_dir: Path) -> SpawnedSite:
    """Start the twins of `spec`, as `emulator.routeros.spawn` does; they end when their standard input does."""
    file, log = state_dir / "site.json", state_dir / "twins.log"
    write_private(file, spec.model_dump_json(indent=1).encode())
    hearing, writing = os.pipe()
    reading, saying = os.pipe()
    with log.open("ab") as errors, os.fdopen(hearing, "rb"), os.fdopen(saying, "wb"):
        module = "atlantis_netcfg.emulator.routeros.__main__"
        request = _Request(module, [str(file), "--state", str(state_dir)], dict(os.environ), session=True)
        process = _start(request, hearing, saying, errors.fileno())
    process.stdin, process.stdout = os.fdopen(writing, "w"), os.fdopen(reading)
    return SpawnedSite(cast("subprocess.Popen[str]", process), log)


@dataclass(frozen=True)
class _Request:
    """What a child becomes; the descriptors beyond the standard streams have the same numbers there."""

    module: str
    """Its `main` is what runs."""
    arguments: list[str]
    env: dict[str, str]
    passed: list[int] = field(default_factory=list)
    session: bool = False
    """In a session of its own."""
    folder: str = field(default_factory=os.getcwd)
    program: str = "provision"
    """By what name it was typed."""


_Settings = frozenset[tuple[str, str]]


def _settings(env: Mapping[str, str]) -> _Settings:
    """Whatever Ansible reads when it is imported, but its home, which each child reads anew; it stands in the key."""
    configuration = Path(env["ANSIBLE_CONFIG"]).read_text(encoding="utf-8")
    names = {name for name in env if name.startswith(("ANSIBLE_", "LC_", "PYTHON"))} | {"LANG", "HOME", "PATH"}
    values = {name: env[name] for name in names - {"ANSIBLE_HOME"} if name in env}
    return frozenset([*values.items(), (_CONFIGURATION, configuration)])


def _start(request: _Request, *streams: int, settings: _Settings = frozenset()) -> Process:
    ours, answer = socket.socketpair()
    with (
        answer,
        os.fdopen(os.memfd_create("request"), "w+b", buffering=0) as words,
        Path("/proc/thread-self/ns/net").open("rb") as network,
        Path("/proc/thread-self/ns/mnt").open("rb") as mounts,
    ):
        words.write(json.dumps(asdict(request)).encode())
        spaces = [network.fileno(), mounts.fileno()]
        descriptors = [answer.fileno(), words.fileno(), *spaces, *streams, *request.passed]
        socket.send_fds(_prepared(settings), [b"!"], descriptors)
    return Process(ours)


def _read_all(readers: Sequence[BinaryIO]) -> list[str]:
    """All at the same time: a command that waits for one of them to be read would wait for ever."""
    texts = [b""] * len(readers)

    def read(number: int) -> None:
        texts[number] = readers[number].read()

    threads = [threading.Thread(target=read, args=(number,)) for number in range(1, len(readers))]
    for thread in threads:
        thread.start()
    read(0)
    for thread in threads:
        thread.join()
    return [text.decode() for text in texts]


def _prepared(settings: _Settings) -> socket.socket:
    if __name__ == "__main__":
        return socket.socket(fileno=os.dup(_CHILDREN))
    return server(sys.executable, settings)


@cache
def server(python: str, settings: _Settings = frozenset()) -> socket.socket:
    """Start the prepared process of a checkout, with settings for Ansible; it ends with the process of the tests."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        process = subprocess.Popen(
            [python, "-P", __file__, str(theirs.fileno())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            env=dict(settings) if settings else None,
        )

    def end() -> None:
        ours.close()
        process.wait()

    atexit.register(end)
    return ours


def client(descriptor: int) -> list[str]:
    """Words that stand for `provision` where a shell or another program starts it; it inherits the `server`."""
    python = Path(sys.base_prefix) / "bin" / f"python3.{sys.version_info.minor}"
    return [str(python), "-I", "-S", str(Path(__file__).with_name("preforked_client.py")), str(descriptor)]


class _Server:
    """Forks a child for each request, tells who asked how it ended, and kills it when nobody waits for it any more."""

    def __init__(self, control: socket.socket) -> None:
        theirs, self.inner = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            os.dup2(theirs.fileno(), _CHILDREN, inheritable=False)
        self.selector = selectors.DefaultSelector()
        for one in (control, self.inner):
            self.selector.register(one, selectors.EVENT_READ, partial(self._accept, one))
        self.request: list[int] | None = None
        """In a child: the descriptors that came for it."""

    def serve(self) -> list[int] | None:
        """Give, in a child, what came for it; and None at the end."""
        while self.selector.get_map() and self.request is None:
            for key, _ in self.selector.select():
                key.data()
                if self.request is not None:
                    break
        return self.request

    def _accept(self, control: socket.socket) -> None:
        data, descriptors, *_ = socket.recv_fds(control, 1, 64)
        if not data:
            for one in (control, self.inner):
                self.selector.unregister(one)
            return
        child = os.fork()
        if child == 0:
            self._leave()
            self.request = descriptors
            return
        answer = socket.socket(fileno=descriptors[0])
        for descriptor in descriptors[1:]:
            os.close(descriptor)
        process = os.pidfd_open(child)

        def ended() -> None:
            self.selector.unregister(process)
            os.close(process)
            _, status = os.waitpid(child, 0)
            if answer in self.selector.get_map():
                self.selector.unregister(answer)
            with answer, suppress(OSError):
                answer.sendall(str(os.waitstatus_to_exitcode(status)).encode())

        def given_up() -> None:
            self.selector.unregister(answer)
            signal.pidfd_send_signal(process, signal.SIGKILL)

        self.selector.register(process, selectors.EVENT_READ, ended)
        self.selector.register(answer, selectors.EVENT_READ, given_up)

    def _leave(self) -> None:
        """Let go, in a child, of what is closed by number; it would be closed again, and be another's by then."""
        for key in [*self.selector.get_map().values()]:
            if isinstance(key.fileobj, socket.socket):
                key.fileobj.detach()
        self.selector.close()


def _become(descriptors: list[int]) -> str:
    """Take the caller's place: its namespaces, descriptors, environment, folder and words; give the module to run."""
    _, words, network, mounts, *streams = [fcntl.fcntl(descriptor, fcntl.F_DUPFD, _HIGH) for descriptor in descriptors]
    os.closerange(3, _HIGH)
    with os.fdopen(words, "rb") as file:
        file.seek(0)
        request = _Request(**json.load(file))
    for space, name, kind in ((network, "net", _NEW_NETWORK), (mounts, "mnt", _NEW_MOUNTS)):
        if os.fstat(space).st_ino != Path(f"/proc/self/ns/{name}").stat().st_ino:
            libc = ctypes.CDLL(None, use_errno=True)
            assert libc.setns(space, kind) == 0, os.strerror(ctypes.get_errno())
    for descriptor, number in zip(streams, (0, 1, 2, *request.passed), strict=True):
        os.dup2(descriptor, number)
    os.closerange(_HIGH, _HIGH + len(descriptors) + 1)
    sys.stdin, sys.stdout, sys.stderr = (
        open(number, mode, encoding=stream.encoding, errors=stream.errors, closefd=False)  # noqa: SIM115 - streams
        for number, mode, stream in ((0, "r", sys.stdin), (1, "w", sys.stdout), (2, "w", sys.stderr))
    )
    if request.session:
        os.setsid()
    os.environ.clear()
    os.environ.update(request.env)
    time.tzset()
    os.chdir(request.folder)
    sys.argv = [request.program, *request.arguments]
    if "ansible.constants" in sys.modules:
        _read_settings()
    return request.module


def _read_settings() -> None:
    """Let Ansible read its settings again, in a child: its home is in them, and a folder of the process's own."""
    from ansible import constants  # noqa: PLC0415 - not of every process
    from ansible.utils.path import cleanup_tmp_file  # noqa: PLC0415 - as above

    atexit.unregister(cleanup_tmp_file)
    for setting in constants.config.get_configuration_definitions():
        constants.set_constant(setting, constants.config.get_config_value(setting, variables=vars(constants)))


def _read_names() -> None:
    """Read, once for all children, Ansible's table of the names that its modules had: 90 ms."""
    finder: Any = import_module("ansible.utils.collection_loader._collection_finder")
    table = Path(import_module("ansible.config").__path__[0]) / "ansible_builtin_runtime.yml"
    finder._meta_yml_to_dict = cache(finder._meta_yml_to_dict)
    finder._meta_yml_to_dict(table.read_bytes(), ("ansible.builtin", "runtime.yml"))


def _main() -> int:
    control = socket.socket(fileno=int(sys.argv[1]))
    if os.geteuid() == 0:  # the namespace of the test that comes first would stay as long as we do
        ctypes.CDLL(None).unshare(_NEW_NETWORK)
    prepared = os.environ.pop(_CONFIGURATION, None) is not None
    with TemporaryDirectory() if prepared else nullcontext() as home:
        if home is not None:
            os.environ["ANSIBLE_HOME"] = home
        for name in (*PRELOADED, *(ANSIBLE if prepared else ())):
            import_module(name)
        if prepared:
            _read_names()
        else:
            import_module("atlantis_netcfg.operations.common.rehearsal").spawn = spawn  # type: ignore[attr-defined]
        assert ("ansible.constants" in sys.modules) == prepared
    signal.signal(signal.SIGINT, signal.default_int_handler)
    gc.collect()
    gc.freeze()
    descriptors = _Server(control).serve()
    if descriptors is None:
        return 0
    main: Any = import_module(_become(descriptors)).main
    return int(main())


if __name__ == "__main__":
    sys.exit(_main())
