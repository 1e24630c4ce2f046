"""One command of the authority in a process of its own, to be killed.

The CA key comes from a file that the test has put beside the folder: no cut waits for the passphrase' second. Processes
are forks of one that has imported everything, and has done it all once: what a trace shows is the command's.
"""

import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path

from authority_stand import NAMES, PASSPHRASE, Stand, handed_to, stand, wish

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.authority.model import EnrolmentFile
from atlantis_netcfg.vpn.authority.signer import Signer
from atlantis_netcfg.vpn.identity import Identity

KEY = "ca-key-of-the-test.pem"
SAID = "stderr-of-the-test"
_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["authority_warm"])


def place(work: Path) -> Stand:
    """An authority in `work`, and its CA key for the commands."""
    made = stand(work)
    (work / KEY).write_text(pki.key_pem(made.ca.key).reveal())
    return made


def run(work: Path, text: str, ca: pki.Ca | None = None) -> None:
    """The command, in this process."""
    folder = work / "vpn"
    command, *names = text.split()
    if command == "init":
        Authority.init(folder, PASSPHRASE, NAMES, "child", "vault")
    elif command == "seen":
        Authority.open(folder).record_sessions(dict.fromkeys(names, datetime.now(UTC)), "child")
    else:
        ca = _ca(work) if ca is None else ca
        assert ca is not None
        with Authority.open(folder)._open_for_signing(ca, "child") as signer:
            _sign(signer, folder, command, names)


def _ca(work: Path) -> pki.Ca | None:
    if not (work / KEY).exists():
        return None
    return pki.load_ca((work / "vpn" / "ca.crt").read_text("ascii"), Secret((work / KEY).read_text()))


def _sign(signer: Signer, folder: Path, command: str, names: list[str]) -> None:
    def deliver(identity: Identity) -> EnrolmentFile:
        return handed_to(folder, identity)

    if command == "issue":
        signer.issue([wish(name) for name in names], deliver)
    elif command == "renew":
        for name in names:
            signer.renew(name, deliver)
    elif command == "revoke":
        signer.revoke(names, "lost at sea")
    elif command == "serve":
        signer.serve(replace(NAMES, dns=("other.example",)))
    else:
        signer.publish()


def warm() -> None:
    """Do everything once."""
    with tempfile.TemporaryDirectory() as work:
        run(Path(work), "init")
    with tempfile.TemporaryDirectory() as work:
        place(Path(work))
        for command in ("issue a", "renew iqua-a", "seen iqua-a.2", "revoke iqua-a", "publish"):
            run(Path(work), command)


def main(work: Path, command: str, gate: Connection) -> None:
    """Wait at the gate, then do it; ends as the command line would."""
    os.dup2(os.open(work / SAID, os.O_WRONLY | os.O_CREAT | os.O_APPEND), 2)
    ca = _ca(work)
    gate.send("ready")
    gate.recv()
    code = 0
    try:
        run(work, command, ca)
    except NetcfgError as error:
        os.write(2, f"{type(error).__name__}: {error}\nhint: {error.hint}\n".encode())
        code = error.exit
    except BaseException as error:  # noqa: BLE001 - the test reads it
        os.write(2, f"our fault: {error!r}\n".encode())
        code = 1
    os._exit(code)


@dataclass
class Child:
    """A process at the gate."""

    work: Path
    pid: int
    _gate: Connection
    _process: multiprocessing.process.BaseProcess

    def go(self) -> None:
        self._gate.send("go")

    def wait(self) -> tuple[int, str]:
        """How it ended, and what it said."""
        self._process.join()
        assert self._process.exitcode is not None
        return self._process.exitcode, (self.work / SAID).read_text()


@cache
def _started() -> None:
    """Start the process that the others are forks of; Python 3.11 does not tell it where modules are."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join(sys.path)
    try:
        forkserver.ensure_running()
    finally:
        del os.environ["PYTHONPATH"]
        if before is not None:
            os.environ["PYTHONPATH"] = before


@contextmanager
def child(work: Path, command: str) -> Iterator[Child]:
    _started()
    ours, theirs = _SERVER.Pipe()
    process = _SERVER.Process(target=main, args=(work, command, theirs))
    process.start()
    theirs.close()
    try:
        assert ours.recv() == "ready"
        assert process.pid is not None
        yield Child(work, process.pid, ours, process)
    finally:
        process.kill()
        process.join()
        process.close()
        ours.close()


def traced(work: Path, command: str, *options: str) -> tuple[int, str]:
    """Do it under strace from its first call on."""
    with child(work, command) as one:
        arguments = ["strace", "-f", "-p", str(one.pid), *options]
        with subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True) as strace:
            assert strace.stderr is not None
            attached = strace.stderr.readline()
            assert "attached" in attached, attached
            one.go()
            ended = one.wait()
    return ended
