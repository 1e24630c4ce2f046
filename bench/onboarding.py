"""Many devices brought into a VPN in one batch: our command, and easy-rsa making as many certificates.

Both have an authority before, with one device in it, and both make keys and certificates of EC P-256 one after the
other. What they made is counted and checked by OpenSSL afterwards, so that nobody is quicker by making less.
"""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pyrage

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn.pki import CorruptSealError, unseal_with
from bench import measure
from bench.declared import Declared
from bench.figures import Onboarding
from bench.job import Command

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

__all__ = ["EASY_RSA", "OURS", "easy_rsa_version", "onboardings"]

OURS, EASY_RSA = "ours", "easy-rsa"
_TOOL = "/usr/share/easy-rsa/easyrsa"
"""Where Debian has it."""
_LOOP = 'i=0; while [ $i -lt "$2" ]; do "$1" build-client-full "device-$i" nopass || exit 1; i=$((i + 1)); done'
_POOL = "10.80.64.0/18"
_PASSPHRASE = "orchard lantern seventeen"  # noqa: S105 - of an authority that lives as long as a run


def easy_rsa_version() -> str | None:
    """Name and version of the package; None if it is not installed."""
    if not os.access(_TOOL, os.X_OK):
        return None
    requested = ["dpkg-query", "-W", "-f", "${Version}", EASY_RSA]
    process = subprocess.run(requested, capture_output=True, text=True, check=False)  # noqa: S603 - our own words
    return f"{EASY_RSA} {process.stdout.strip() or 'of unknown version'}"


def onboardings(devices: int, runs: int, folder: Path) -> Iterator[Onboarding]:
    """Measure ours so many times, and easy-rsa once: it takes minutes."""
    for contender, once, times in ((OURS, _ours, runs), (EASY_RSA, _easy_rsa, 1)):
        if contender == EASY_RSA and easy_rsa_version() is None:
            yield Onboarding(contender, devices, failure="it is not installed")
            continue
        ran = [once(devices, _made(folder / f"{contender}-{devices}-{time}")) for time in range(times)]
        yield Onboarding(
            contender,
            devices,
            tuple(cost for cost, _ in ran),
            next((failure for _, failure in ran if failure), ""),
        )


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _ours(devices: int, folder: Path) -> tuple[measure.Cost, str]:
    """`provision vpn onboard batch=…`: everything that a technician has done by it, but what the server is told."""
    inventory = Declared.make(folder).inventory
    partners = inventory / "group_vars" / "all" / "partners.yml"
    with partners.open("a", encoding="utf-8") as file:
        file.write(f"  swarm: {{full_name: Swarm, vpn_pool: {_POOL}}}\n")
    word, identity = folder / "passphrase", pyrage.x25519.Identity.generate()
    word.write_text(f"{_PASSPHRASE}\n", encoding="utf-8")
    authority = folder / "authority"

    def command(*words: str) -> Command:
        places = (f"authority={authority}", f"inventory={inventory}", "--passphrase-fd", "3")
        ours = (sys.executable, "-P", "-m", "atlantis_netcfg", "vpn", *words, *places)
        return Command(("/bin/sh", "-c", 'word=$1; shift; exec "$@" 3<"$word"', "sh", str(word), *ours))

    def onboard(name: str, many: range) -> Command:
        rows = ["partner,device,kind", *(f"swarm,device-{number},laptop" for number in many)]
        (folder / name).write_text("\n".join([*rows, ""]), encoding="utf-8")
        return command("onboard", f"batch={folder / name}", f"recipient={identity.to_public()}", "--no-push")

    _prepare(folder, command("init"), onboard("first.csv", range(devices, devices + 1)))
    return _measured(
        folder,
        onboard("batch.csv", range(devices)),
        authority / "ca.crt",
        lambda: [*authority.glob("certs/*device*.pem")],
        devices,
        lambda: _sealed(authority, Secret(str(identity)), devices),
    )


def _sealed(authority: Path, identity: Secret, devices: int) -> str:
    """What is wrong with the sealed files; all are opened. The cover notes beside them are sealed for nobody."""
    files = [*(authority / "handouts").rglob("*.age")]
    try:
        opened = sum(len(unseal_with(file.read_bytes(), identity)) > 0 for file in files)
    except CorruptSealError as damaged:
        return str(damaged)
    return "" if opened == devices + 1 else f"{opened} sealed files, and not {devices + 1}"


def _easy_rsa(devices: int, folder: Path) -> tuple[measure.Cost, str]:
    """`build-client-full NAME nopass` for each, as its documentation has it; it knows no batch."""
    environment = {"EASYRSA_BATCH": "1", "EASYRSA_ALGO": "ec", "EASYRSA_CURVE": "prime256v1"}

    def command(*words: str) -> Command:
        return Command((_TOOL, *words), environment)

    first = command("build-client-full", "first", "nopass")
    _prepare(folder, command("init-pki"), command("--req-cn=bench", "build-ca", "nopass"), first)
    batch = Command(("/bin/sh", "-c", _LOOP, "sh", _TOOL, str(devices)), environment)
    pki = folder / "pki"
    return _measured(folder, batch, pki / "ca.crt", lambda: [*pki.glob("issued/*.crt")], devices, lambda: "")


def _prepare(folder: Path, *commands: Command) -> None:
    for command in commands:
        ran = measure.run_command(command, folder)
        if ran.code != 0:
            raise RuntimeError(f"what comes before the batch has failed: {command.argv}\n{ran.output}")


def _measured(  # noqa: PLR0913, PLR0917 - a batch, and what must be there after it
    folder: Path,
    batch: Command,
    ca: Path,
    certificates: Callable[[], Sequence[Path]],
    devices: int,
    more: Callable[[], str],
) -> tuple[measure.Cost, str]:
    ran = measure.run_command(batch, folder)
    if ran.code != 0:
        return ran.cost, f"exit code {ran.code}: {ran.output.strip().splitlines()[-1:]}"
    good = _verified(ca, certificates())
    if good != devices + 1:
        return ran.cost, f"{good} certificates of the authority, and not {devices + 1}"
    return ran.cost, more()


def _verified(ca: Path, certificates: Sequence[Path]) -> int:
    """How many of them OpenSSL takes for a client's of that authority."""
    requested = ["openssl", "verify", "-purpose", "sslclient", "-CAfile", str(ca), *map(str, certificates)]
    process = subprocess.run(requested, capture_output=True, text=True, check=False)  # noqa: S603 - our own words
    return sum(line.endswith(": OK") for line in process.stdout.splitlines())
