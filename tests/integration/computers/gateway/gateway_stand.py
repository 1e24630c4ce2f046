"""Gateway computers for the tests of this folder: machines from one tree that holds what any of them needs.

from gateway_stand import gateway_tree, ground, machine   # fixtures; the tests are marked `namespace`

def test_it(machine: Start, tmp_path: Path) -> None:
    gateway = machine("coastal-gateway")
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from debian_trees import GATEWAY

from atlantis_netcfg.emulator.lab import Lab, Machine, build_rootfs, open_lab, why_not
from atlantis_netcfg.inventory import load

SHIPPED = load(Path(__file__).parents[4] / "inventory")
FREE_CLOCK = "[Unit]\nConditionCapability=\n[Service]\nExecStart=\nExecStart=!/usr/sbin/chronyd -x\n"
"""A container may not set the clock of this computer: chrony runs all the same then, and leaves the clock alone."""
NETWORK, ROUTER = "10.64.1.", "10.64.1.1"
_FIRST = 10


def gateway_tree() -> Path:
    """The tree of all these tests, in the user's cache: built once, in about 90 s."""
    return build_rootfs(GATEWAY)


@dataclass(frozen=True)
class Key:
    """A technician's key: the file that ssh takes, and the line of authorized_keys."""

    file: Path
    public: str


class Start(Protocol):
    """Starts a machine; addresses are 10.64.1.10, .11, … unless one is given with its prefix."""

    def __call__(self, name: str = ..., /, *, address: str | None = ..., **how: Any) -> Machine: ...  # noqa: ANN401


@pytest.fixture(scope="session")
def technician(tmp_path_factory: pytest.TempPathFactory) -> Key:
    """One key for all machines of a run."""
    made = Ed25519PrivateKey.generate()
    private = made.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.OpenSSH, serialization.NoEncryption()
    )
    public = made.public_key().public_bytes(serialization.Encoding.OpenSSH, serialization.PublicFormat.OpenSSH)
    file = tmp_path_factory.mktemp("technician") / "id_ed25519"
    file.touch(mode=0o600)
    file.write_bytes(private)
    return Key(file, public.decode())


@pytest.fixture
def ground(tmp_path: Path) -> Iterator[Lab]:
    """A yard that stands as long as the test; its end is the router's address."""
    if (reason := why_not()) is not None:
        pytest.skip(reason)
    with open_lab(tmp_path / "yard") as made:
        made.add_address(f"{ROUTER}/24")
        yield made


@pytest.fixture
def machine(ground: Lab, technician: Key) -> Start:
    """Starts machines in the test's yard; `how` is what `Yard.start` takes."""
    numbers = itertools.count(_FIRST)

    def start(name: str = "coastal-gateway", /, *, address: str | None = None, **how: Any) -> Machine:  # noqa: ANN401
        chosen = f"{NETWORK}{next(numbers)}/24" if address is None else address
        wanted = {"keys": (technician.public,), "gateway": ROUTER} | how
        return ground.start(name, gateway_tree(), address=chosen, **wanted)

    return start


def known_hosts(folder: Path, *machines: Machine) -> Path:
    """A file with the keys of these machines, as ssh knows them by the ports here."""
    lines = [f"[127.0.0.1]:{one.port} {one.host_key}\n" for one in machines]
    (folder / "known_hosts").write_text("".join(lines))
    return folder / "known_hosts"


def ssh(one: Machine, key: Key, folder: Path) -> list[str]:
    """The words before a command that runs on a machine, by SSH through its port."""
    options = {
        "IdentitiesOnly": "yes",
        "StrictHostKeyChecking": "yes",
        "UserKnownHostsFile": str(known_hosts(folder, one)),
        "BatchMode": "yes",
    }
    said = [word for name, value in options.items() for word in ("-o", f"{name}={value}")]
    return ["ssh", "-F", "none", "-i", str(key.file), "-p", str(one.port), *said, "root@127.0.0.1"]
