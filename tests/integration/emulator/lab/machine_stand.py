"""A bare Debian for the tests of machines, a technician's SSH, and what a yard may have left on this computer."""

from base64 import b64decode
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import paramiko
import pytest
from debian_trees import BARE
from waiting import HANG_S

from atlantis_netcfg.emulator.lab import Lab, Machine, build_rootfs, open_lab, why_not

ADDRESS, ROUTER = "10.64.1.10/24", "10.64.1.1"


@pytest.fixture(scope="session")
def bare() -> Path:
    """The smallest tree, in the user's cache."""
    if (reason := why_not()) is not None:
        pytest.skip(reason)
    return build_rootfs(BARE)


@pytest.fixture
def ground(bare: Path, tmp_path: Path) -> Iterator[Lab]:
    assert bare.is_dir()
    with open_lab(tmp_path / "yard") as made:
        yield made


@pytest.fixture(scope="session")
def key() -> paramiko.PKey:
    return paramiko.ECDSAKey.generate()


@pytest.fixture
def gateway(ground: Lab, bare: Path, key: paramiko.PKey) -> Machine:
    public = f"{key.get_name()} {key.get_base64()}"
    return ground.start("coastal-gateway", bare, address=ADDRESS, gateway=ROUTER, keys=(public,), disk_mb=64)


def client(machine: Machine) -> paramiko.SSHClient:
    """An SSH client that trusts the declared key of this one machine."""
    kind, text = machine.host_key.split()
    made = paramiko.SSHClient()
    made.set_missing_host_key_policy(paramiko.RejectPolicy())
    made.get_host_keys().add(f"[127.0.0.1]:{machine.port}", kind, paramiko.Ed25519Key(data=b64decode(text)))
    return made


def ssh(machine: Machine, key: paramiko.PKey, command: str) -> str:
    """What a command says to whoever logs in as root through the port here."""
    with client(machine) as one:
        one.connect("127.0.0.1", machine.port, "root", pkey=key, allow_agent=False, look_for_keys=False)
        _, answer, _ = one.exec_command(command, timeout=HANG_S)
        return answer.read().decode()


def left(name: str) -> list[str]:
    """Whatever bears the name of a yard: namespaces, mounts, control groups, folders, processes."""
    places = ("run/netns", "run/atlantis/yards", "run/systemd/nspawn/*", "sys/fs/cgroup", "sys/fs/cgroup/*")
    found = [str(path) for place in places for path in Path("/").glob(f"{place}/*{name}*")]
    found += [line for line in Path("/proc/self/mountinfo").read_text().splitlines() if name in line]
    return found + [words for words in _running() if name in words]


def _running() -> Iterator[str]:
    for process in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            yield process.read_text(errors="replace").replace("\0", " ")
