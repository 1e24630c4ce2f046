"""`provision report drift` as a technician runs it: somebody changes the router by hand, and is told, and put right."""

import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import pytest
from quay import CHECKOUT, ROUTER, Quay, quay

from atlantis_netcfg.emulator.routeros import User
from atlantis_netcfg.runs import Store

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

GOLDEN = Path(__file__).with_name("golden")
BOB = User(name="bob", password="the boat is red")


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Quay]:
    with quay(tmp_path, BOB) as opened:
        yield opened


def types(at: Quay, *words: str) -> None:
    """Bob types a command on the router."""
    answer = at.do("console", words=list(words), user=BOB.name)[-1]
    assert answer[0] == "!done", answer


def row(at: Quay, menu: str, comment: str) -> str:
    """The `.id` of the first row with this comment."""
    for kind, *words in at.do("console", words=[f"{menu}/print"]):
        values = dict(word[1:].partition("=")[::2] for word in words)
        if kind == "!re" and values.get("comment") == comment:
            return str(values[".id"])
    raise LookupError(comment)


def tinker(at: Quay) -> None:
    """What a helpful stranger does in an afternoon."""
    rules = "/ip/firewall/filter"
    types(at, f"{rules}/set", f"=.id={row(at, rules, 'atlantis: ping from management')}", "=disabled=yes")
    types(at, f"{rules}/set", f"=.id={row(at, rules, 'atlantis: ntp1.atlantis.internal')}", "=dst-address=10.9.9.9")
    wifi, known = row(at, rules, "atlantis: ping over wifi-ptp, to test it"), row(at, rules, "atlantis: answers")
    types(at, f"{rules}/move", f"=numbers={wifi}", f"=destination={known}")
    types(at, f"{rules}/add", "=chain=input", "=action=accept", "=src-address=10.9.9.9", "=comment=only for today")
    types(at, f"{rules}/remove", f"=.id={row(at, rules, 'atlantis: LAN by the best link')}")
    types(at, "/ip/dns/set", "=servers=10.9.9.1")
    types(at, "/ip/dns/static/add", "=name=printer", "=address=10.64.1.77")
    types(at, "/interface/ovpn-client/set", "=.id=ovpn-scc", "=password=guessed")
    types(at, "/ip/service/set", "=.id=www", "=disabled=no")
    lists = "/ip/firewall/address-list"
    types(at, f"{lists}/remove", f"=.id={row(at, lists, 'atlantis: ntp1.atlantis.internal, also by satellite')}")


def masked(text: str) -> str:
    """Everything that is new with every run."""
    text = re.sub(r"\b\d{8}T\d{6}Z\b", "RUN", text)
    text = re.sub(r"\b2\d{3}-\d\d-\d\d[ T]\d\d:\d\d(:\d\d)?(\+00:00)?", "TIME", text)
    text = re.sub(r"TIME WES?T \((TIME|\d\d:\d\d) UTC\)", "TIME UTC", text)
    text = re.sub(r'time="\d+\.\d+"', 'time="SECONDS"', text)
    text = re.sub(r'"seconds": \d+\.\d+', '"seconds": 0.0', text)
    return re.sub(r'"(sent|received)": \d+', r'"\1": 0', text)


def golden(name: str, text: str) -> None:
    path = GOLDEN / name
    assert masked(text) == path.read_text(encoding="utf-8"), f"{path}\n{masked(text)}"


@pytest.mark.smoke
def test_foreign_changes_are_reported_and_repaired(at: Quay, tmp_path: Path) -> None:
    at.provision("site=coastal", "--yes", code=0)
    assert "coastal-router: as in the inventory\n" in at.provision("report", "drift", "site=coastal", code=0).stdout
    tinker(at)
    before, entries = at.export(), at.do("console", words=["/system/history/print"])
    at.do("reset")
    told = at.provision("report", "drift", "site=coastal", f"--junit={tmp_path / 'drift.xml'}", code=6)
    assert at.do("counters")["turns"] <= 5
    golden("drift.txt", told.stdout)
    golden("drift.xml", (tmp_path / "drift.xml").read_text(encoding="utf-8"))
    golden("drift.json", json.dumps(at.json("report", "drift", "device=coastal-router", code=6), indent=1) + "\n")
    assert (at.export(), at.do("console", words=["/system/history/print"])) == (before, entries)
    assert len(at.runs()) == 1

    at.provision("site=coastal", "--yes", code=0)
    after = at.provision("report", "drift", "site=coastal", code=0).stdout
    assert "coastal-router: as in the inventory; 1 foreign row left unchanged" in after
    assert "printer" in after
    types(at, "/ip/dns/static/set", "=.id=printer", "=address=10.64.1.78")
    assert (
        "1 difference from the inventory: 1 foreign" in at.provision("report", "drift", "site=coastal", code=6).stdout
    )


def test_no_secret_is_printed_or_stored(at: Quay, tmp_path: Path) -> None:
    at.configure()
    types(at, "/interface/ovpn-client/set", "=.id=ovpn-scc", "=password=guessed")
    said = at.provision("report", "drift", "site=coastal", f"--junit={tmp_path / 'drift.xml'}", code=6).stdout
    said += json.dumps(at.json("report", "drift", "site=coastal", code=6)) + (tmp_path / "drift.xml").read_text(
        encoding="utf-8"
    )
    kept = "".join(path.read_text(encoding="utf-8") for path in at.state.rglob("*") if path.is_file())
    assert list((at.state / "real/coastal/confirmed").iterdir())
    for secret in ("guessed", "a-real-vpn-coastal"):
        assert secret in str(at.do("export", show_sensitive=True)) or secret != "guessed"
        assert secret not in said + kept


def test_newer_inventory_is_distinguished_from_a_changed_device(at: Quay) -> None:
    at.configure()
    site = at.inventory / "group_vars/coastal.yml"
    text = site.read_text(encoding="utf-8")
    site.write_text(text.replace("last: 10.64.1.199", "last: 10.64.1.180"), encoding="utf-8")
    told = masked(at.provision("report", "drift", "site=coastal", code=6).stdout)
    assert "ranges: inventory 10.64.1.100-10.64.1.180, device 10.64.1.100-10.64.1.199" in told
    assert "declared (atlantis: LAN); already so in run RUN: the inventory is newer" in told
    assert "history of the device:" not in told


def test_start_of_drift_is_unknown_without_a_confirmed_run(at: Quay) -> None:
    told = at.provision("report", "drift", "device=coastal-router", code=6).stdout
    assert "unknown since when: no run has confirmed a state of this device" in told
    assert told.count("unknown") == 1
    (device,) = at.json("report", "drift", "device=coastal-router", code=6)["devices"].values()
    assert {one["since"] for one in device["differences"]} == {"unknown"}


def test_a_device_that_cannot_be_read_is_an_error_and_no_drift(at: Quay, tmp_path: Path) -> None:
    at.door.port = 0
    told = at.json("report", "drift", "site=coastal", f"--junit={tmp_path / 'drift.xml'}", code=4)
    assert told["devices"][ROUTER]["verdict"] == "ERROR"
    assert told["devices"][ROUTER]["differences"] == []
    assert "could not be read" in told["errors"][0]["message"]
    suite = ET.parse(tmp_path / "drift.xml").getroot()[0]  # noqa: S314 - our own file
    assert (suite.get("errors"), suite.get("failures"), suite.get("tests")) == ("1", "0", "1")


def test_terminal_has_the_same_verdict_as_in_a_run(at: Quay) -> None:
    typed = ("site=coastal", "device=coastal-sat", "--yes")
    run = at.json(*typed, code=0)["devices"]["coastal-sat"]
    drift = at.json("report", "drift", "site=coastal", "device=coastal-sat", code=0)["devices"]["coastal-sat"]
    assert (drift["verdict"], drift["message"]) == ("WARN", run["message"])
    assert drift["notes"] == run["notes"]


def test_drift_ignores_the_site_lock(at: Quay) -> None:
    with Store(at.state).lock("coastal", "somebody else's run"):
        at.provision("site=coastal", "--yes", code=4)
        at.provision("report", "drift", "site=coastal", code=6)


def test_ansible_in_check_mode_shows_the_same(at: Quay) -> None:
    at.configure()
    types(at, "/ip/dns/static/add", "=name=printer", "=address=10.64.1.77")
    types(at, "/ip/dns/set", "=servers=10.9.9.1")
    shown = at.provision("report", "drift", "site=coastal", code=6).stdout
    done = subprocess.run(
        [
            *(sys.executable, "-m", "ansible", "playbook", "-i", str(at.inventory)),
            *(
                str(CHECKOUT / "playbooks/site.yml"),
                "--limit",
                "coastal:!cpes:!lte_routers:!gateways",
                "--check",
                "--diff",
            ),
        ],
        cwd=CHECKOUT,
        env=at.environment(),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for line in ("foreign  printer A 10.64.1.77", "servers: inventory nothing, device 10.9.9.1"):
        assert line in shown
        assert line in done.stdout
    assert at.export().count("printer") == 1
