"""Checks of keys and passwords: vault, example values, SSH keys, known devices, the VPN's authority.

Nothing secret is shown: a secret is only test-decrypted. For SSH keys the public halves are compared: those beside the
private ones in `~/.ssh`, those that `~/.ssh/config` names, and those of the agent. A key that only a smart card or
another program offers is not detected.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import InventoryInvalid, load, model
from atlantis_netcfg.operations.common.kinds import get_managed_device, is_supported
from atlantis_netcfg.operations.common.vault import PROMPTS
from atlantis_netcfg.operations.doctor.items import DoctorItem, DoctorSection
from atlantis_netcfg.operations.trust import has_identity

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.runs import Pins

_PATIENCE_S = 5.0
_OTHERS = 0o077
"""Permission bits of everybody except the owner."""


def _item(name: str, verdict: Verdict, observation: str, hint: str = "", commands: Sequence[str] = ()) -> DoctorItem:
    return DoctorItem(DoctorSection.KEYS, name, verdict, observation, hint, tuple(commands))


def examples_item(inventory: Inventory) -> DoctorItem:
    """Report whether example values limit the inventory to rehearsals."""
    if inventory.pilot.example_values:
        return _item(
            "example values",
            Verdict.WARN,
            "still in use: rehearsals work, but every real run is refused",
            "replace them, then set `example_values: false` in group_vars/all/pilot.yml",
        )
    return _item("example values", Verdict.PASS, "none left")


def secrets_item(inventory: Path, decrypt: Callable[[str], str]) -> DoctorItem:
    """Decrypt every encrypted value of a valid inventory once; `decrypt` may ask for the password."""
    secret_count = 0

    def count_and_decrypt(text: str) -> str:
        nonlocal secret_count
        secret = decrypt(text)
        secret_count += 1
        return secret

    try:
        load(inventory, decrypt=count_and_decrypt)
    except InventoryInvalid as error:
        first = error.findings[0]
        place = f"{first.file}:{first.line}"
        return _item("vault", Verdict.FAIL, msg(f"{arg(place)}: {arg(first.message)}"), first.hint)
    except UsageError as error:
        return _item("vault", Verdict.INCONCLUSIVE, str(error), (error.hint or "").partition("\n")[0])
    if not secret_count:
        return _item("vault", Verdict.PASS, "no value of the inventory is encrypted, so no password is needed")
    return _item("vault", Verdict.PASS, msg(f"the password decrypts all {arg(secret_count)} encrypted values"))


def password_files(environ: Mapping[str, str]) -> tuple[Path, ...]:
    """Return the vault password files that the environment names, interpreted as by Ansible."""
    identity_files = [each.rpartition("@")[2] for each in environ.get("ANSIBLE_VAULT_IDENTITY_LIST", "").split(",")]
    files = [*identity_files, environ.get("ANSIBLE_VAULT_PASSWORD_FILE", "")]
    return tuple(Path(file.strip()).expanduser() for file in files if file.strip() and file.strip() not in PROMPTS)


def password_file_item(file: Path, inventory: Path) -> DoctorItem:
    """Report whether others can read the file, or whether it is inside the inventory and shared with it."""
    name = "password file"
    try:
        mode = file.stat().st_mode
    except OSError as error:
        return _item(name, Verdict.FAIL, msg(f"cannot read {arg(file)}: {arg(error.strerror)}"), "give another file")
    if mode & _OTHERS and not mode & 0o100:  # a program that prints the password holds none
        return _item(
            name,
            Verdict.FAIL,
            msg(f"other users can read {arg(file)}"),
            commands=[f"chmod 600 {shlex.quote(str(file))}"],
        )
    if file.resolve().is_relative_to(inventory.resolve()):
        return _item(
            name,
            Verdict.WARN,
            msg(f"{arg(file)} is inside the inventory: whoever gets one gets both"),
            "move it elsewhere",
        )
    return _item(name, Verdict.PASS, msg(f"{arg(file)} is readable only by you"))


@dataclass(frozen=True, slots=True)
class LaptopKey:
    """An SSH key of this laptop."""

    public: str
    """Public key: type and base64."""
    file: Path | None
    """File of the private key; None: the agent holds it."""


def laptop_keys(home: Path, agent: str = "") -> tuple[LaptopKey, ...]:
    """Return the keys that OpenSSH would offer; `agent` is the output of `ssh-add -L`."""
    folder = home / ".ssh"
    files = [path for path in sorted(folder.glob("*.pub")) if path.with_suffix("").is_file()]
    files += [path for path in _configured_keys(folder / "config", home) if path.is_file() and path not in files]
    file_keys = [LaptopKey(public, path.with_suffix("")) for path in files if (public := _public_key_of(_text(path)))]
    return (*file_keys, *(LaptopKey(public, None) for line in agent.splitlines() if (public := _public_key_of(line))))


def _configured_keys(config: Path, home: Path) -> Iterator[Path]:
    for name in re.findall(r"^\s*IdentityFile[ \t=]+(\S+)", _text(config), re.MULTILINE | re.IGNORECASE):
        path = name.strip('"').replace("%d", str(home))
        yield Path(f"{home}{path[1:]}.pub" if path.startswith("~/") else f"{path}.pub")


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _public_key_of(line: str) -> str:
    words = line.split()
    return f"{words[0]} {words[1]}" if len(words) > 1 and words[1].startswith("AAAA") else ""


def keys_item(host: str, allowed_keys: Sequence[str], keys: Sequence[LaptopKey]) -> DoctorItem:
    """Report whether this laptop has a private key for one of the host's authorised keys."""
    name = msg(f"SSH key for {arg(host)}")
    public_keys = {_public_key_of(line) for line in allowed_keys}
    fitting = [key for key in keys if key.public in public_keys]
    if not fitting:
        return _item(
            name,
            Verdict.FAIL,
            msg(f"none of its {arg(len(public_keys))} keys in the inventory is in ~/.ssh or in the agent"),
            msg(f"use a laptop that has one, or add your key to `ssh_keys` in host_vars/{arg(host)}.yml"),
        )
    in_agent = next((key for key in fitting if key.file is None), None)
    key = in_agent or fitting[0]
    if key.file is None:
        return _item(name, Verdict.PASS, "the agent has a key from the inventory")
    if key.file.stat().st_mode & _OTHERS:
        return _item(
            name,
            Verdict.FAIL,
            msg(f"other users can read {arg(key.file)}: OpenSSH refuses such a key"),
            commands=[f"chmod 600 {shlex.quote(str(key.file))}"],
        )
    return _item(name, Verdict.PASS, f"{key.file}")


def _read_output(words: Sequence[str]) -> str:
    """Return the output of an OpenSSH program; empty if it is missing or fails."""
    if shutil.which(words[0]) is None:
        return ""
    try:
        process = subprocess.run(  # noqa: S603 - our own words
            words,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_PATIENCE_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return process.stdout if process.returncode == 0 else ""


def agent_keys() -> str:
    """Return the agent's public keys; empty if no agent runs."""
    return _read_output(["ssh-add", "-L"]) if os.environ.get("SSH_AUTH_SOCK") else ""


def in_known_hosts(name: str, home: Path) -> bool:
    """Return whether OpenSSH knows a host key under the name of the host."""
    files = (home / ".ssh" / "known_hosts", home / ".ssh" / "known_hosts2", Path("/etc/ssh/ssh_known_hosts"))
    return any(_read_output(["ssh-keygen", "-F", name, "-f", str(file)]) for file in files if file.is_file())


def known_devices_item(
    inventory: Inventory, hosts: Sequence[Host], pins: Pins, is_known: Callable[[str], bool]
) -> DoctorItem:
    """Report whether the devices' identities are known, from the inventory or from pins on this computer."""
    name = "known devices"
    if inventory.pilot.example_values:
        return _item(name, Verdict.SKIP, "the devices in the inventory are examples")
    every = [host for host in hosts if has_identity(host)]
    try:
        unknown = [host for host in every if not _is_known(inventory, host, pins, is_known)]
    except NetcfgError as error:
        return _item(name, Verdict.FAIL, str(error), error.hint or "")
    if not every:
        return _item(name, Verdict.SKIP, "provision logs in to no device")
    if not unknown:
        return _item(
            name,
            Verdict.PASS,
            msg(f"all {arg(len(every))}: certificate or host key is in the inventory, or stored here"),
        )
    names = join(", ", (host.name for host in unknown))
    return _item(
        name,
        Verdict.WARN,
        msg(f"{arg(len(unknown))} of {arg(len(every))} not known here and therefore refused: {arg(names)}"),
        "at the site, on a terminal (for a new router use `device adopt` instead):",
        [f"provision device trust site={unknown[0].site}"],
    )


def _is_known(inventory: Inventory, host: Host, pins: Pins, is_known: Callable[[str], bool]) -> bool:
    if is_supported(host):
        return bool(get_managed_device(inventory, host).access.fingerprint or pins.get(host.name))
    if isinstance(host.device, model.LteRouter):
        fingerprint = host.device.access.fingerprint if host.device.access is not None else None
        return bool(fingerprint or pins.get(host.name))
    assert isinstance(host.device, model.SshHost)  # noqa: S101 - `has_identity` has said so
    return host.device.ssh.host_key is not None or is_known(host.name)


def authority_item(folder: Path) -> DoctorItem:
    """Report the state of the VPN authority on this laptop; reading needs neither lock nor passphrase."""
    from atlantis_netcfg.vpn.authority.authority import Authority  # noqa: PLC0415 - few laptops have an authority

    name = "VPN authority"
    if not Authority.exists(folder):
        return _item(name, Verdict.SKIP, "not on this laptop: only needed to enrol members")
    problems = Authority(folder).check()
    if not problems:
        return _item(name, Verdict.PASS, msg(f"{arg(folder)}: nothing to do"))
    more = msg(f" (and {arg(len(problems) - 1)} more)" if len(problems) > 1 else "")
    return _item(name, Verdict.WARN, f"{problems[0]}{more}")


def key_items(
    inventory: Inventory, hosts: Sequence[Host], decrypt: Callable[[str], str], pins: Pins, home: Path
) -> Iterator[DoctorItem]:
    """Check the keys and passwords that these hosts need."""
    yield examples_item(inventory)
    yield secrets_item(inventory.root, decrypt)
    for file in password_files(os.environ):
        yield password_file_item(file, inventory.root)
    keys = laptop_keys(home, agent_keys())
    for host in hosts:
        if isinstance(host.device, model.SiteComputer) and host.device.image is not None and host.device.image.ssh_keys:
            if inventory.pilot.example_values:
                yield _item(
                    msg(f"SSH key for {arg(host.name)}"), Verdict.SKIP, "its keys in the inventory are examples"
                )
            else:
                yield keys_item(host.name, host.device.image.ssh_keys, keys)
    yield known_devices_item(inventory, hosts, pins, lambda name: in_known_hosts(name, home))
