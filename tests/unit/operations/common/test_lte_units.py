"""4G units of other makes in a run: set, read back, judged; each driver by a variant of the shipped inventory."""

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.emulator.modem import AtModemSpec, RunningModem
from atlantis_netcfg.emulator.rutos import RunningRutos, Rutos, RutosNetwork, RutosSim, RutosSpec
from atlantis_netcfg.links.lte import rutos_read
from atlantis_netcfg.operations.lte.run import perform
from atlantis_netcfg.runs import Journal, JournalError, Store

SHIPPED = Path(__file__).parents[4] / "inventory"
NAME = "te4sea-4g"
RIGHT, WRONG = (rf'!vault "$ANSIBLE_VAULT;1.1;AES256\n{pin.encode().hex()}"' for pin in ("98979695", "97959391"))
"""Vaulted as far as the loader can see; `opened` is the way back."""
SECRETS = ("EXAMPLE-4g-te4sea", "EXAMPLE-4g-admin-te4sea", "98979695", "97959391", "EXAMPLE-apn-password")
ADMIN = "\n    admin_user: root\n    admin_password: EXAMPLE-4g-admin-te4sea"
BASE = """\
---
device:
  kind: lte_router
  address: 10.10.9.1
  powered_by: {device: te4sea-router, port: ether1}
"""


def opened(text: str) -> str:
    return bytes.fromhex(text.rsplit(maxsplit=1)[-1]).decode()


@dataclass(slots=True)
class Deck:
    """The vessel's inventory, and what stands at the place of its 4G unit."""

    folder: Path
    stack: ExitStack
    target: dict[str, Any] | None = None
    told: list[dict[str, Any]] = field(default_factory=list)

    def declare(self, text: str) -> None:
        (self.folder / "inventory/host_vars/te4sea-4g.yml").write_text(BASE + text, encoding="utf-8")

    def rutos(self, sim: str = "apn: internet", *, admin: bool = True) -> None:
        access = f"user: provision\n    password: EXAMPLE-4g-te4sea{ADMIN if admin else ''}"
        self.declare(f"  driver: rutos\n  access:\n    {access}\n  sim: {{{sim}}}\n")

    def unit(self, name: str = "unit", **said: Any) -> Rutos:  # noqa: ANN401 (fields of RutosSpec)
        users = {"reader": "provision", "reader_password": SECRETS[0], "admin_password": SECRETS[1]}
        spec = RutosSpec(name=NAME, **{"serial_number": "1000000001", **users, **said})
        running = self.stack.enter_context(RunningRutos(spec, self.folder / name))
        at = running.ready
        keys = {"host": "host", "port": "https", "pin": "pin", "ssh": "ssh", "host_key": "host_key"}
        self.target = {ours: at[theirs] for ours, theirs in keys.items()}
        return running.unit

    def run(self, mode: str = "apply", **asked: Any) -> dict[str, Any]:  # noqa: ANN401 (fields of Request)
        reader, writer = os.pipe()
        request = {
            "state": str(self.folder / "state"),
            "mode": mode,
            "rehearsed": True,
            "targets": {NAME: self.target} if self.target is not None else {},
            "events_fd": writer,
            **asked,
        }
        try:
            hosts = (NAME, "te4sea-router")
            outcome = perform(self.folder / "inventory", hosts, request, plan_only=False, decrypt=opened)
        finally:
            os.close(writer)
            with os.fdopen(reader) as lines:
                self.told = [json.loads(line) for line in lines]
        (result,) = outcome["per_host"].values()
        assert not [secret for secret in SECRETS if secret in json.dumps([outcome, self.told])]
        return dict(result)

    @property
    def store(self) -> Store:
        return Store(self.folder / "state", is_rehearsal=True)


@pytest.fixture
def deck(tmp_path: Path) -> Iterator[Deck]:
    shutil.copytree(SHIPPED, tmp_path / "inventory")
    with ExitStack() as stack:
        yield Deck(tmp_path, stack)
    kept = [path for path in (tmp_path / "state").rglob("*") if path.is_file()]
    assert not [path for path in kept for secret in SECRETS if secret in path.read_text(encoding="utf-8")]


def ends(result: dict[str, Any]) -> tuple[str, int, int]:
    return result["status"], result["exit"], result["planned"]


def test_settings_are_applied_once_and_second_run_changes_nothing(deck: Deck) -> None:
    deck.rutos("apn: internet, user: one, password: EXAMPLE-apn-password")
    twin = deck.unit(sim=RutosSim(apn="internet", is_listed=False))
    first = deck.run()
    assert ends(first) == ("changed", 0, 6)
    assert first["message"] == "6 settings applied and verified; registered home (EXAMPLE-OPERATOR lte B3)"
    assert (first["ok"], first["changed"], first["confirmed"]) == (True, True, 6)
    assert first["diff"].splitlines()[:2] == [
        "- set network.mob1s1a1.auto_apn='1'",
        "+ set network.mob1s1a1.auto_apn='0'",
    ]
    assert twin.modem.settings["password"] == "EXAMPLE-apn-password"
    after = twin.export()
    second = deck.run()
    assert ends(second) == ("unchanged", 0, 0)
    assert (second["changed"], second["diff"], second["serial"]) == (False, "", "1000000001")
    assert (twin.export(), twin.shell.reloads) == (after, 1)


def test_journal_records_settings_before_they_are_sent(deck: Deck) -> None:
    deck.rutos()
    deck.unit()
    deck.run()
    (run,) = deck.store.runs("te4sea")
    kinds = [str(record.kind) for record in run.log.records]
    assert kinds == [
        *("run-started", "state-saved", "planned", "layer-sent", "actions-confirmed", "outcome", "run-ended")
    ]
    assert (run.exit, run.confirmed_actions(NAME), run.settled_devices) == (0, (1, 2, 3), frozenset({NAME}))
    before = run.before(NAME)
    assert before is not None
    assert "network.mob1s1a1.auto_apn='1'" in before.text()


def test_plan_changes_nothing_and_only_the_approved_plan_is_applied(deck: Deck) -> None:
    deck.rutos()
    twin = deck.unit()
    before = twin.export()
    planned = deck.run("plan")
    assert ends(planned) == ("planned", 2, 3)
    assert (twin.export(), twin.shell.reloads, deck.store.runs("te4sea")) == (before, 0, ())
    other = deck.run(plans={NAME: "0" * 64})
    assert ends(other) == ("left-as-found", 4, 0)
    assert "the differences are no longer those that were confirmed" in other["message"]
    assert twin.export() == before
    assert ends(deck.run(plans={NAME: planned["plan_hash"]})) == ("changed", 0, 3)


def test_without_an_admin_user_settings_are_only_checked(deck: Deck) -> None:
    deck.rutos(admin=False)
    twin = deck.unit()
    result = deck.run()
    assert ends(result) == ("unchanged", 0, 0)
    assert result["message"].startswith("checked only; registered home")
    assert "no `admin_user` under `access`" in result["notes"][-1]
    assert twin.shell.commands == []


def test_correct_pin_is_tried_once(deck: Deck) -> None:
    deck.rutos(f"pin: {RIGHT}")
    twin = deck.unit(sim=RutosSim(pin="98979695"))
    assert ends(deck.run()) == ("changed", 0, 2)
    assert (twin.modem.attempts, twin.modem.registration) == (1, "Registered, home")
    assert ends(deck.run()) == ("unchanged", 0, 0)
    assert twin.modem.attempts == 1


def test_wrong_pin_is_tried_only_once_even_if_the_inventory_changes(deck: Deck) -> None:
    deck.rutos(f"pin: {WRONG}, roaming: true")
    twin = deck.unit(sim=RutosSim(pin="98979695"))
    first = deck.run()
    assert (first["exit"], twin.modem.attempts, first["planned"], first["confirmed"]) == (6, 1, 1, 0)
    assert first["message"].startswith("0 settings applied and verified, PIN removed; ")
    assert "pincode" not in twin.export()
    assert "the SIM refused the PIN; it will not be tried again; tries left: 2" in first["message"]
    second = deck.run()
    assert ends(second) == ("left-as-found", 4, 0)
    assert second["message"].startswith("not changed: the PIN was sent at ")
    assert "unlock the SIM in a telephone" in second["hint"]
    deck.rutos(f"pin: {RIGHT}, apn: internet")
    assert ends(deck.run()) == ("left-as-found", 4, 0)
    assert (twin.modem.attempts, twin.shell.reloads) == (1, 1)
    (mark,) = (deck.folder / "state").rglob("*.tried")
    mark.unlink()
    assert ends(deck.run()) == ("changed", 0, 4)
    assert (twin.modem.attempts, twin.modem.registration) == (2, "Registered, home")
    assert ends(deck.run()) == ("unchanged", 0, 0)


def test_another_pin_may_be_tried_after_the_sim_was_unlocked(deck: Deck) -> None:
    deck.rutos(f"pin: {WRONG}, roaming: true")
    deck.unit("locked", sim=RutosSim(pin="98979695"))
    assert deck.run()["exit"] == 6
    deck.unit("unlocked-in-a-telephone")
    assert ends(deck.run()) == ("unchanged", 0, 0)
    deck.rutos(f"pin: {RIGHT}, roaming: true")
    twin = deck.unit("locked-again", sim=RutosSim(pin="98979695"))
    assert ends(deck.run()) == ("changed", 0, 1)
    assert twin.modem.attempts == 1


@pytest.mark.parametrize(
    ("sim", "said", "words"),
    [
        ("apn: internet", {"sim": RutosSim(pin="98979695")}, "the SIM asks for a PIN, but the inventory has none"),
        (f"pin: {RIGHT}", {"sim": RutosSim(pin="98979695", tries=0)}, "asks for its PUK"),
        (
            f"pin: {RIGHT}",
            {"sim": RutosSim(pin="98979695", tries=1)},
            "the SIM has one PIN try left, which is reserved for a person",
        ),
    ],
)
def test_locked_sim_is_left_alone(deck: Deck, sim: str, said: dict[str, Any], words: str) -> None:
    deck.rutos(sim)
    twin = deck.unit(**said)
    before = twin.export()
    result = deck.run()
    assert ends(result) == ("left-as-found", 4, 0)
    assert words in result["message"]
    assert (twin.modem.attempts, twin.shell.reloads, twin.export()) == (0, 0, before)


@pytest.mark.parametrize(
    ("sim", "said", "code"),
    [
        ("apn: internet", {"network": RutosNetwork(plmn="20601")}, "roaming-not-allowed"),
        ("roaming: true", {"sim": RutosSim(apn="internet", is_listed=False)}, "apn-missing"),
        ("apn: wrong", {"sim": RutosSim(apn="internet")}, "no-address"),
        ("apn: internet", {"sim": None}, "sim-missing"),
        ("apn: internet", {"network": RutosNetwork(denies=True)}, "registration-denied"),
        ("apn: internet", {"network": RutosNetwork(silent=True)}, "searching"),
    ],
)
def test_each_fault_has_its_message(deck: Deck, sim: str, said: dict[str, Any], code: str) -> None:
    deck.rutos(sim)
    deck.unit(**said)
    result = deck.run()
    finding = next(one for one in result["findings"] if one["verdict"] == "FAIL")
    assert finding["code"] == code
    assert result["exit"] == 6
    assert finding["message"] in result["message"]
    assert result["hint"] == finding["hint"]
    assert not result["ok"]
    again = deck.run()
    assert (ends(again), again["findings"]) == (("unchanged", 6, 0), result["findings"])


def test_declared_roaming_is_a_warning(deck: Deck) -> None:
    deck.rutos("apn: internet, roaming: true")
    deck.unit(network=RutosNetwork(plmn="20601"))
    result = deck.run()
    assert ends(result) == ("changed", 0, 2)
    assert result["notes"][0].startswith("WARN: the SIM roams in EXAMPLE-OPERATOR")


def test_unsaved_settings_are_reported(deck: Deck) -> None:
    deck.rutos()
    deck.unit().shell.mute = True
    result = deck.run()
    assert ends(result) == ("left-as-found", 4, 0)
    assert "0 of 3 settings were saved; not saved: network.mob1s1a1.auto_apn" in result["message"]


def test_session_lost_during_a_network_reload_is_reopened(deck: Deck) -> None:
    deck.rutos()
    twin = deck.unit()
    twin.shell.drops_on_reload = True
    assert ends(deck.run()) == ("changed", 0, 3)
    assert twin.shell.commands[-1] == "uci show network && uci show simcard"
    assert ends(deck.run()) == ("unchanged", 0, 0)


def test_unsupported_firmware_is_refused(deck: Deck) -> None:
    deck.rutos()
    twin = deck.unit(mobile_section=False)
    before = twin.export()
    result = deck.run()
    assert ends(result) == ("left-as-found", 4, 0)
    assert "no mobile interface for slot 1" in result["message"]
    assert twin.export() == before


def test_replaced_unit_is_detected_by_its_serial_number(deck: Deck) -> None:
    deck.rutos()
    deck.unit("one")
    deck.run()
    twin = deck.unit("other", serial_number="1000000002")
    result = deck.run()
    assert ends(result) == ("left-as-found", 4, 0)
    assert "serial number 1000000002, expected 1000000001" in result["message"]
    assert twin.shell.commands == []


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"pin": "0" * 64}, "the certificate is not the one of this unit"),
        ({"host_key": "SHA256:other"}, "the SSH host key is not the one"),
        ({"port": 1}, "the 4G unit does not respond"),
        ({"ssh": 1}, "cannot open an SSH session"),
    ],
)
def test_unverified_unit_receives_no_commands(deck: Deck, changed: dict[str, Any], words: str) -> None:
    deck.rutos()
    twin = deck.unit()
    assert deck.target is not None
    deck.target |= changed
    result = deck.run()
    assert ends(result) == ("left-as-found", 4, 0)
    assert words in result["message"]
    assert twin.shell.commands == []


def test_at_modem_settings_are_compared_but_not_set(deck: Deck) -> None:
    deck.declare("  driver: at\n  serial: /dev/ttyUSB2\n  sim: {apn: other}\n")
    running = deck.stack.enter_context(RunningModem(AtModemSpec()))
    deck.target = {"host": "", "port": 0, "pin": "", "serial": running.path}
    result = deck.run()
    assert ends(result) == ("unchanged", 0, 0)
    assert result["notes"][0].startswith("WARN: the APN in use is internet, the inventory has other")
    assert result["notes"][-1] == "driver at is read-only: the SIM settings are compared but not set"
    assert running.forbidden == []
    first = {name: result[name] for name in ("status", "exit", "message", "notes", "quality")}
    assert first == {name: value for name, value in deck.run().items() if name in first}


@pytest.mark.parametrize(
    ("driver", "message"),
    [
        ("modemmanager", "not checked: driver modemmanager has no emulator"),
        ("manual", "not checked: this 4G unit must be checked by hand"),
    ],
)
def test_unchecked_unit_exits_with_nothing(deck: Deck, driver: str, message: str) -> None:
    deck.declare(f"  driver: {driver}\n")
    result = deck.run()
    assert (ends(result), result["message"]) == (("unchanged", 7, 0), message)
    assert result["ok"]
    if driver == "manual":
        assert "http://10.10.9.1/" in result["notes"][0]


def test_nothing_is_changed_when_the_journal_cannot_be_written(deck: Deck, monkeypatch: pytest.MonkeyPatch) -> None:
    deck.rutos()
    twin = deck.unit()
    before = twin.export()
    write = Journal.write

    def full(self: Journal, record: Any) -> None:  # noqa: ANN401 (any record)
        if record.kind == "layer-sent":
            raise JournalError("cannot add the journal: no space left on device")
        write(self, record)

    monkeypatch.setattr(Journal, "write", full)
    result = deck.run()
    assert result["status"] == "left-as-found"
    assert result["exit"] not in (0, 2)
    assert "no space left on device" in result["message"]
    assert (twin.export(), twin.shell.reloads) == (before, 0)


def test_internal_error_is_reported_with_its_log(deck: Deck, monkeypatch: pytest.MonkeyPatch) -> None:
    deck.rutos()
    deck.unit()
    monkeypatch.setattr(rutos_read, "read", lambda _endpoint: 1 // 0)
    result = deck.run()
    assert (result["exit"], result["status"]) == (1, "unknown")
    assert "ZeroDivisionError" in result["message"]
    assert list((deck.folder / "state" / "log").iterdir())
    assert deck.store.runs("te4sea")[0].exit == 1


def test_other_run_modes_skip_the_unit(deck: Deck) -> None:
    deck.rutos()
    twin = deck.unit()
    for asked in ({"mode": "drift"}, {"mode": "backup"}, {"back_to": "20260101T000000Z"}):
        request = {"state": str(deck.folder / "state"), "rehearsed": True, "targets": {NAME: deck.target}, **asked}
        done = perform(deck.folder / "inventory", (NAME,), request, plan_only=False, decrypt=str)
        assert done == {"per_host": {}}
    assert twin.web.requests == []
