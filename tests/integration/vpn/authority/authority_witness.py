"""What an authority's folder holds, told by openssl and by the text of its ledger: not by the code under test."""

import hashlib
import json
import re
import ssl
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

_CERTIFICATE = re.compile(r"-----BEGIN CERTIFICATE-----.*?-----END CERTIFICATE-----", re.DOTALL)


@dataclass(frozen=True)
class Listed:
    """The published list."""

    number: int
    serials: frozenset[str]


def listed(folder: Path) -> Listed:
    """It is signed by the CA beside it, and not expired; openssl says so."""
    asked = ["openssl", "crl", "-in", str(folder / "crl.pem"), "-CAfile", str(folder / "ca.crt"), "-noout", "-text"]
    said = subprocess.run(asked, capture_output=True, text=True, check=True)
    assert "verify OK" in said.stderr, said.stderr
    until = re.search(r"Next Update: (.+) GMT", said.stdout)
    since = re.search(r"Last Update: (.+) GMT", said.stdout)
    number = re.search(r"X509v3 CRL Number:\s+([0-9A-Fx]+)", said.stdout)
    assert until
    assert since
    assert number
    assert _moment(since[1]) < datetime.now(UTC) < _moment(until[1])
    serials = frozenset(one.lower().lstrip("0") for one in re.findall(r"Serial Number: ([0-9A-F]+)", said.stdout))
    return Listed(int(number[1], 0), serials)


def records(folder: Path) -> list[dict[str, Any]]:
    """The whole lines of the ledger."""
    return [json.loads(line) for line in (folder / "ledger.jsonl").read_text().split("\n")[:-1]]


def issued(folder: Path) -> dict[str, dict[str, Any]]:
    """What was issued, by common name; none of it twice."""
    found = [record for record in records(folder) if record["kind"] == "issued"]
    for unique in ("common_name", "serial", "sha256"):
        assert len({record[unique] for record in found}) == len(found)
    for name in {record["name"] for record in found}:
        assert len({record["address"] for record in found if record["name"] == name}) == 1
    owners = {(record["name"], record["address"]) for record in found}
    assert len({address for _, address in owners}) == len(owners)
    return {record["common_name"]: record for record in found}


def nothing_outside_the_record(folder: Path) -> None:
    """Every certificate that lies anywhere below the folder is in the ledger."""
    recorded = {record["sha256"] for record in records(folder) if "sha256" in record}
    recorded |= {record["ca_sha256"] for record in records(folder) if record["kind"] == "founded"}
    for path in folder.rglob("*"):
        if path.is_file() and path.name not in {"ledger.jsonl", "ca.key.vault", "ca.key.age"}:
            for pem in _CERTIFICATE.findall(path.read_text(errors="replace")):
                assert hashlib.sha256(ssl.PEM_cert_to_DER_cert(pem)).hexdigest() in recorded, path


def admitted(folder: Path) -> dict[str, list[str]]:
    """Common names that OpenVPN would admit by CA and list, of each name; each was handed out, whole."""
    certificates = issued(folder)
    handed_out = {record["common_name"]: record for record in records(folder) if record["kind"] == "delivered"}
    on_list = listed(folder).serials
    found: dict[str, list[str]] = {record["name"]: [] for record in certificates.values()}
    for common_name, record in certificates.items():
        if record["serial"] in on_list:
            continue
        with open(handed_out[common_name]["path"], "rb") as file:  # noqa: PTH123 - a path of the ledger's text
            data = file.read()
        assert hashlib.sha256(data).hexdigest() == handed_out[common_name]["sha256"]
        assert b"BEGIN PRIVATE KEY" in data
        found[record["name"]].append(common_name)
    _verified(folder, [one for some in found.values() for one in some], certificates)
    return found


def _verified(folder: Path, good: list[str], certificates: dict[str, dict[str, Any]]) -> None:
    """Ask openssl of every certificate, with the list."""
    ca, crl = str(folder / "ca.crt"), str(folder / "crl.pem")
    checks = ["openssl", "verify", "-crl_check", "-CAfile", ca, "-CRLfile", crl]
    paths = [str(folder / "certs" / f"{name}.pem") for name in certificates]
    if paths:
        said = subprocess.run([*checks, *paths], capture_output=True, text=True, check=False).stdout
        assert {line.removesuffix(": OK") for line in said.splitlines() if line.endswith(": OK")} == {
            str(folder / "certs" / f"{name}.pem") for name in good
        }


def private_and_clean(folder: Path) -> None:
    """No half-written file is left, and nobody else can read anything."""
    for path in (folder, *folder.rglob("*")):
        assert not path.name.startswith("."), path
        assert path.stat().st_mode & 0o077 == 0, path


def _moment(text: str) -> datetime:
    return datetime.strptime(text, "%b %d %H:%M:%S %Y").replace(tzinfo=UTC)
