"""What is assumed about RutOS: the rows, the code that rests on them, and what an emulated unit shows of them."""

import re
from collections.abc import Mapping
from dataclasses import replace
from ipaddress import IPv4Address
from pathlib import Path
from typing import Any

import pytest
from test_rutos_reader import PASSWORD, unit

from atlantis_netcfg.core.errors import TRUST
from atlantis_netcfg.core.events import Verdict, ignore
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.rutos import Rutos
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import LteRouter
from atlantis_netcfg.links.lte.rutos_client import CertificateUnknown
from atlantis_netcfg.links.lte.rutos_read import read
from atlantis_netcfg.operations import Request
from atlantis_netcfg.operations.lte.assumptions import ASSUMPTIONS, judge
from atlantis_netcfg.operations.verify import Verifying, write_report
from atlantis_netcfg.routeros.assumptions import READS

PACKAGE = Path(__file__).parents[4] / "atlantis_netcfg"
IDS = [each.id for each in ASSUMPTIONS]
BY_READING = {each.id for each in ASSUMPTIONS if each.proof == READS}
BY_PAGES = {"rutos-address", "rutos-serial"}
"""These need pages that older firmware does not have."""


def sources() -> dict[str, str]:
    files = [*PACKAGE.glob("links/lte/rutos_*.py"), *PACKAGE.glob("emulator/rutos/*.py")]
    return {file.relative_to(PACKAGE).as_posix(): file.read_text(encoding="utf-8") for file in files}


def test_rows_are_unique_and_complete() -> None:
    assert len(set(IDS)) == len(IDS)
    for each in ASSUMPTIONS:
        assert each.id.startswith("rutos-")
        assert each.sentence.endswith(".")
        assert each.rests.endswith(".")
        assert each.proof == READS or each.proof.startswith("needs a person: ")


def test_source_references_exactly_the_listed_assumptions() -> None:
    named = {name for text in sources().values() for name in re.findall(r"Assumption: ([a-z0-9-]+)", text)}
    assert named == set(IDS)


def test_source_contains_no_unlisted_inference() -> None:
    words = re.compile(r"infer(?:red|ence)|\[memory\]|not documented", re.IGNORECASE)
    assert [name for name, text in sources().items() if words.search(text)] == []


def verdicts(folder: Path, *, twist: Any = None, **said: Any) -> dict[str, Verdict]:  # noqa: ANN401 (fields of RutosSpec)
    with unit(folder, serial_number=said.pop("serial_number", "1234567890"), **said) as (emulated, endpoint):
        if twist is not None:
            twist(emulated)
        findings = judge(read(endpoint)).findings
    assert [each.id for each in findings] == IDS
    assert all(each.evidence for each in findings)
    assert "1234567890" not in str(findings)
    return {each.id: each.verdict for each in findings}


def with_verdict(found: Mapping[str, Verdict], verdict: Verdict) -> set[str]:
    return {name for name, each in found.items() if each is verdict}


@pytest.mark.parametrize("old_names", [True, False])
@pytest.mark.parametrize("numbers_as_text", [True, False])
def test_all_assumptions_hold(tmp_path: Path, *, old_names: bool, numbers_as_text: bool) -> None:
    found = verdicts(tmp_path, old_names=old_names, numbers_as_text=numbers_as_text)
    assert with_verdict(found, Verdict.PASS) == BY_READING
    assert with_verdict(found, Verdict.SKIP) == set(IDS) - BY_READING


def test_older_firmware_proves_fewer_assumptions(tmp_path: Path) -> None:
    found = verdicts(tmp_path, api=False)
    assert with_verdict(found, Verdict.PASS) == BY_READING - BY_PAGES
    assert with_verdict(found, Verdict.FAIL) == set()


def test_assumptions_on_unreadable_pages_neither_pass_nor_fail(tmp_path: Path) -> None:
    found = verdicts(tmp_path, hidden_pages=("/api/interfaces/basic/status",), missing=("/api/system/device/status",))
    assert with_verdict(found, Verdict.PASS) == BY_READING - BY_PAGES
    assert with_verdict(found, Verdict.FAIL) == set()


def test_signal_levels_are_not_judged_without_a_sim(tmp_path: Path) -> None:
    found = verdicts(tmp_path, sim=None)
    assert with_verdict(found, Verdict.PASS) == {"rutos-state-words", "rutos-serial"}
    assert with_verdict(found, Verdict.FAIL) == set()


@pytest.mark.parametrize(
    ("name", "row"),
    [
        ("rutos-state-words", {"netstate": "Camped"}),
        ("rutos-state-words", {"state": "Up"}),
        ("rutos-levels", {"rsrp": None, "rsrp_dbm": -94}),
        ("rutos-levels", {"sinr": "excellent"}),
        ("rutos-cell", {"conntype": "Cellular", "ntype": "Cellular"}),
        ("rutos-cell", {"band": "1800 MHz"}),
        ("rutos-cell", {"cellid": None, "eci": "3103242"}),
        ("rutos-cell", {"cell_info": None}),
    ],
)
def test_unexpected_modem_reply_fails_only_its_assumption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, row: dict[str, object]
) -> None:
    def twist(emulated: Rutos) -> None:
        told = emulated.modem.status()
        monkeypatch.setattr(emulated.modem, "status", lambda: told | row)

    assert with_verdict(verdicts(tmp_path, twist=twist), Verdict.FAIL) == {name}


@pytest.mark.parametrize(
    "row", [{"id": "wwan0", "ipaddrs": ["100.64.12.34/32"]}, {"id": "mob1s1a1", "v4": "100.64.1.2"}]
)
def test_unexpected_interface_reply_fails_only_its_assumption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, row: dict[str, object]
) -> None:
    def twist(emulated: Rutos) -> None:
        monkeypatch.setattr(emulated.modem, "interfaces", lambda: [row])

    assert with_verdict(verdicts(tmp_path, twist=twist), Verdict.FAIL) == {"rutos-address"}


def test_missing_serial_number_fails_only_its_assumption(tmp_path: Path) -> None:
    assert with_verdict(verdicts(tmp_path, serial_number=" "), Verdict.FAIL) == {"rutos-serial"}


def verifying(running: dict[str, Any], state: Path, **access: object) -> Verifying:
    """The declared unit of te4sea, where an emulated one stands at its address."""
    declaration = load(PACKAGE.parent / "inventory")
    host = declaration.hosts["te4sea-4g"]
    assert isinstance(host.device, LteRouter)
    assert host.device.access is not None
    changes = {"port": running["https"], "user": "reader", "password": Secret(PASSWORD), **access}
    device = host.device.model_copy(
        update={"address": IPv4Address(running["host"]), "access": host.device.access.model_copy(update=changes)}
    )
    return Verifying(declaration, replace(host, device=device), Request(state=state), ignore)


def test_unknown_unit_gets_no_password_and_report_has_no_secrets(tmp_path: Path) -> None:
    with unit(tmp_path / "unit") as (emulated, endpoint):
        running = {"host": endpoint.host, "https": endpoint.port}
        with pytest.raises(CertificateUnknown) as caught:
            verifying(running, tmp_path / "state").run()
        assert (emulated.web.requests, TRUST in str(caught.value.hint)) == ([], True)
        verified = verifying(running, tmp_path / "state", fingerprint=endpoint.pin).run()
    assert (verified.exit, verified.is_rehearsal, verified.number(Verdict.PASS)) == (0, False, len(BY_READING))
    file = write_report(verified, tmp_path / "state").file
    assert file is not None
    kept = file.read_text(encoding="utf-8")
    assert "te4sea-4g" in kept
    assert not [word for word in ("127.0.0.1", "100.64.", PASSWORD, "3103242") if word in kept]
