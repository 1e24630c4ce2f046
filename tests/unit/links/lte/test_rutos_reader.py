"""The RutOS reader: its words from data cases, its talk against the twin over real TLS."""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.rutos import RunningRutos, Rutos, RutosNetwork, RutosSim, RutosSpec
from atlantis_netcfg.links.lte import LteReading, Registration, rutos_client
from atlantis_netcfg.links.lte.rutos_read import modem_of, read, reading_of

CASES: list[dict[str, Any]] = yaml.safe_load(Path(__file__).with_name("rutos_cases.yml").read_text(encoding="utf-8"))
PASSWORD = "a-reader's-password"


@contextmanager
def unit(folder: Path, **said: Any) -> Iterator[tuple[Rutos, rutos_client.RutosEndpoint]]:  # noqa: ANN401 (fields of RutosSpec)
    with RunningRutos(RutosSpec(name="te4sea-4g", reader_password=PASSWORD, **said), folder) as running:
        ready = running.ready
        yield (
            running.unit,
            rutos_client.RutosEndpoint(ready["host"], ready["https"], "reader", Secret(PASSWORD), ready["pin"]),
        )


@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case["why"])[:60])
def test_modem_data_is_read(case: dict[str, Any]) -> None:
    expected = {field.name: None for field in dataclasses.fields(LteReading)} | {"source": "rutos"} | case["reading"]
    found = dataclasses.asdict(reading_of(case["modem"], case.get("interfaces")))
    state = Registration(case["reading"]["state"])
    assert found == expected | {"state": state, "is_connected": case.get("connected")}


def test_personal_identifiers_are_not_kept() -> None:
    modem = {
        "imei": "356938035643809",
        "imsi": "268031234567890",
        "iccid": "8935103000000000001",
        "netstate": "Roaming",
    }
    told = repr(reading_of(modem))
    assert not [number for name, number in modem.items() if name != "netstate" and number in told]


def test_primary_modem_is_used() -> None:
    rows = [{"id": "3-1", "primary": "0"}, {"id": "2-1", "primary": "1"}]
    assert modem_of(rows) == rows[1]
    assert modem_of([{"id": "3-1"}]) == {"id": "3-1"}
    assert modem_of([]) is None


@pytest.mark.parametrize("old_names", [True, False])
@pytest.mark.parametrize("numbers_as_text", [True, False])
def test_reading_takes_five_requests(tmp_path: Path, *, old_names: bool, numbers_as_text: bool) -> None:
    with unit(tmp_path, serial_number="1234567890", old_names=old_names, numbers_as_text=numbers_as_text) as (twin, at):
        look = read(at)
        assert twin.web.requests == [
            *("POST /api/login", "GET /api/modems/status", "GET /api/sim_cards/status"),
            *("GET /api/interfaces/basic/status", "GET /api/system/device/status"),
        ]
    assert (look.requests, look.serial, look.reading.is_connected, len(look.slots)) == (5, "1234567890", True, 2)
    reading = look.reading
    assert (reading.state, reading.plmn, reading.address) == (Registration.REGISTERED_HOME, "26803", "100.64.12.34")
    assert (reading.rsrp_dbm, reading.band, reading.access_tech) == (-94, "B3", "lte")


def test_older_firmware_is_read_by_ubus(tmp_path: Path) -> None:
    with unit(tmp_path, api=False) as (twin, at):
        look = read(at)
        assert twin.web.requests == ["POST /api/login", "POST /ubus", "POST /ubus", "POST /ubus"]
    assert (look.reading.state, look.reading.rsrp_dbm, look.reading.is_connected) == (
        Registration.REGISTERED_HOME,
        -94,
        True,
    )
    assert (look.reading.band, look.serial) == ("B3", None)


def test_an_empty_slot_reads_as_in_the_captured_record(tmp_path: Path) -> None:
    with unit(tmp_path, sim=None) as (_, at):
        assert read(at).reading == dataclasses.replace(reading_of(CASES[0]["modem"]))


def test_a_foreign_network_with_roaming_denied_has_no_address(tmp_path: Path) -> None:
    with unit(tmp_path, network=RutosNetwork(plmn="20601")) as (twin, at):
        twin.uci.batch("set simcard.@sim[0].deny_roaming='1'\ncommit simcard\n")
        twin.modem.reload()
        look = read(at)
    assert (look.reading.state, look.reading.address) == (Registration.REGISTERED_ROAMING, None)
    assert look.reading.is_connected is False


def test_missing_pages_are_tolerated(tmp_path: Path) -> None:
    missing = ("/api/interfaces/basic/status", "/api/sim_cards/status")
    with unit(tmp_path, missing=missing, hidden_pages=("/api/system/device/status",)) as (_, at):
        look = read(at)
    assert (look.reading.state, look.reading.address) == (Registration.REGISTERED_HOME, None)
    assert (look.serial, look.slots) == (None, ())


def test_a_token_that_has_run_out_is_renewed_once(tmp_path: Path) -> None:
    with unit(tmp_path) as (twin, at):
        twin.web.expire_after = 1
        assert read(at).reading.state is Registration.REGISTERED_HOME
        assert twin.web.requests.count("POST /api/login") == 2


def test_missing_permission_is_named(tmp_path: Path) -> None:
    with (
        unit(tmp_path, hidden_pages=("/api/modems/status",)) as (_, at),
        pytest.raises(rutos_client.RutosError) as caught,
    ):
        read(at)
    assert "/api/modems/status (HTTP 403)" in str(caught.value)


@pytest.mark.parametrize("api", [True, False])
def test_a_wrong_password_is_tried_once(tmp_path: Path, *, api: bool) -> None:
    with unit(tmp_path, api=api) as (twin, at), pytest.raises(rutos_client.RutosLoginError) as caught:
        read(dataclasses.replace(at, password=Secret("hunter2")))
    assert twin.web.failed_logins == 1
    assert "hunter2" not in f"{caught.value}{caught.value.hint}"


def test_no_password_is_sent_to_an_unknown_certificate(tmp_path: Path) -> None:
    with unit(tmp_path) as (twin, at):
        with pytest.raises(rutos_client.CertificateUnknown) as unknown:
            read(dataclasses.replace(at, pin=None))
        with pytest.raises(rutos_client.CertificateMismatch):
            read(dataclasses.replace(at, pin="0" * 64))
        assert unknown.value.fingerprint == at.pin
        assert twin.web.requests == []


def test_unreachable_unit_is_reported(tmp_path: Path) -> None:
    with unit(tmp_path) as (_, at):
        pass
    with pytest.raises(rutos_client.RutosUnreachable):
        read(at)


def test_locked_sim_is_reported(tmp_path: Path) -> None:
    with unit(tmp_path, sim=RutosSim(pin="1234", tries=2)) as (_, at):
        reading = read(at).reading
    assert (reading.state, reading.pin_tries_left) == (Registration.SIM_PIN_REQUIRED, 2)
