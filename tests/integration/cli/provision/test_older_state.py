"""What older versions wrote is read, resumed, rolled back, audited and verified: tests/data/written-by-102db09."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import preforked
import pytest
from hints_said import advised, said
from quay import CHECKOUT, ROUTER, Quay, quay

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.runs import Store
from atlantis_netcfg.vpn.enrolment_package import open_package

pytestmark = pytest.mark.slow
WRITTEN = CHECKOUT / "tests" / "data" / "written-by-102db09" / "state.tar.gz"
SIGN = "if `provision vpn list` shows every member, `provision vpn sync --sign` signs it from now on"
PASSPHRASE = b"mackerel lantern orbit velvet"


@pytest.fixture(scope="session")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("older")
    subprocess.run(["tar", "-xzf", str(WRITTEN), "-C", str(folder)], check=True)
    return folder


@pytest.fixture
def older(unpacked: Path, tmp_path: Path) -> Path:
    return shutil.copytree(unpacked, tmp_path / "older")


def typed(state: Path, *words: str, code: int, passphrase: bool = False, **environment: str) -> str:
    reading, writing = os.pipe()
    with os.fdopen(writing, "wb") as pipe:
        pipe.write(PASSPHRASE + b"\n")
    try:
        done = preforked.run(
            [*words, *((f"--passphrase-fd={reading}",) if passphrase else ())],
            env={**os.environ, **environment, "ATLANTIS_STATE": str(state)},
            pass_fds=(reading,),
        )
    finally:
        os.close(reading)
    assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout if "--json" in words else done.stdout + done.stderr


def rows(text: str) -> list[str]:
    """Lines of an export, unfolded, without what a newer emulated router shows and an older one did not."""
    return sorted(text.replace("\\\n    ", "").splitlines())


def met(at: Quay, older: Path, name: str) -> None:
    """Give the laptop the older state; the router's certificate was made anew since."""
    Store(older / name).pins.change(ROUTER, at.twins.ready[ROUTER]["pin"])
    at.state = older / name


def configured(older: Path) -> str:
    """What the older version had laid down, beyond what an adopted router has."""
    adopted = (older / "before.rsc").read_text(encoding="utf-8").splitlines()
    folded = "\n".join(adopted[1:3])
    after = (older / "after.rsc").read_text(encoding="utf-8")
    assert folded in after
    return after.replace(folded + "\n", "")


def test_old_runs_and_pins_are_listed_unchanged(older: Path) -> None:
    expected = json.loads((older / "confirmed.json").read_text(encoding="utf-8"))
    assert Store(older / "confirmed").pins.get(ROUTER) == expected["pin"]
    listed: list[dict[str, Any]] = json.loads(
        typed(older / "confirmed", "report", "runs", "site=coastal", "--json", code=0)
    )["runs"]
    kept = [{key: row[key] for key in expected["runs"][0]} for row in listed]
    assert [row for row in kept if row in expected["runs"]] == expected["runs"]


@pytest.mark.smoke
@pytest.mark.namespace
def test_a_run_is_rolled_back(older: Path, tmp_path: Path) -> None:
    (first, *_) = sorted(path.name for path in (older / "confirmed/real/coastal/runs").iterdir())
    with quay(tmp_path, seed=configured(older)) as at:
        met(at, older, "confirmed")
        at.provision("recover", "rollback", "site=coastal", f"run={first}", "--yes", code=0)
        assert rows(at.export()) == rows((older / "before.rsc").read_text(encoding="utf-8"))
        assert at.json("site=coastal", "--yes", code=0)["devices"][ROUTER]["status"] == "changed"
        assert at.json("site=coastal", "--yes", code=0)["devices"][ROUTER]["status"] == "unchanged"


@pytest.mark.namespace
def test_old_confirmed_state_is_the_baseline_of_drift_and_next_run(older: Path, tmp_path: Path) -> None:
    with quay(tmp_path, seed=configured(older)) as at:
        met(at, older, "confirmed")
        at.json("report", "drift", "site=coastal", code=6)
        assert at.json("site=coastal", "--yes", code=0)["devices"][ROUTER]["status"] == "changed"
        at.json("report", "drift", "site=coastal", code=0)


@pytest.mark.namespace
def test_a_killed_run_is_resumed(older: Path, tmp_path: Path) -> None:
    with quay(tmp_path) as at:
        met(at, older, "killed")
        assert rows(at.export()) == rows((older / "killed.rsc").read_text(encoding="utf-8"))
        assert [row["unfinished"] for row in at.runs()] == [True]
        assert at.json("recover", "resume", "site=coastal", code=0)["devices"][ROUTER]["status"] == "changed"
        assert at.json("plan", "site=coastal", code=0)["devices"][ROUTER]["planned"] == 0
        assert not any(row["unfinished"] for row in at.runs())


def starts(audit: str) -> list[list[str]]:
    """Time and person of each line of an audit, whose words may have become others since."""
    return [line.split("  ")[:2] for line in audit.splitlines()]


@pytest.mark.namespace
def test_old_authority_can_be_listed_audited_and_used(older: Path, tmp_path: Path) -> None:
    words = (f"authority={older / 'vpn' / 'authority'}", f"inventory={CHECKOUT / 'inventory'}")
    expected = json.loads((older / "vpn-list.json").read_text(encoding="utf-8"))["members"]
    listed = json.loads(typed(older, "vpn", "list", words[0], "--json", code=0))["members"]
    assert [{key: row[key] for key in expected[0]} for row in listed] == expected
    # It signed no end of its ledger: that is no green audit, and the next signature ends it.
    audit = typed(older, "vpn", "audit", words[0], code=6)
    assert starts(audit)[: len(recorded := starts((older / "vpn-audit.txt").read_text("utf-8"))[:-1])] == recorded
    assert "--no-push" not in typed(older, "vpn", "sync", *words, code=3), "it is no flag of this command"
    (_, sign) = advised(said(audit, SIGN))
    with quay(tmp_path) as at:
        typed(older, *sign, f"inventory={at.inventory}", passphrase=True, code=5, **at.environment())
    typed(older, "vpn", "audit", words[0], code=0)
    revoke = ("vpn", "revoke", "name=udg-girona", "reason=sold", "--yes", "--no-push", *words)
    typed(older, *revoke, passphrase=True, code=5)
    typed(older, "vpn", "renew", "name=coastal-gateway", "--no-push", *words, passphrase=True, code=0)
    members = json.loads(typed(older, "vpn", "list", words[0], "--json", code=0))["members"]
    assert {row["name"] for row in members if row["standing"] == "revoked"} == {"udg-girona", "inesc-camera"}
    head = older / "vpn" / "authority" / "ledger.head"
    assert json.loads(head.read_text("utf-8"))["line"] > 0
    typed(older, "vpn", "audit", words[0], code=0)


@pytest.mark.parametrize(("name", "device"), [("udg-girona", "girona"), ("inesc-camera", "camera")])
def test_old_enrolment_package_can_be_opened(name: str, device: str, older: Path) -> None:
    (member,) = json.loads((older / f"onboard-{device}.json").read_text(encoding="utf-8"))["members"]
    sealed = (older / "vpn/authority/handouts" / name / f"{name}.tar.age").read_bytes()
    opened = open_package(sealed, Secret(member["passphrase"]))
    assert any(path.endswith(".ovpn") for path in opened), opened


def test_a_signed_checklist_is_verified_listed_and_shown(older: Path) -> None:
    state = older / "check"
    (report,) = (state / "rehearsal/coastal/checks").glob("*/report.json")
    run = report.parent.name
    assert run in typed(state, "report", "verify", "site=coastal", code=0)
    assert run in typed(state, "report", "checklists", "site=coastal", "--rehearse", code=0)
    assert run in typed(state, "report", "show", "site=coastal", f"run={run}", "--rehearse", code=0)
    records = report.with_name("records.jsonl")
    records.write_text(records.read_text("utf-8").replace('"PASS"', '"FAIL"', 1).replace("pass", "fail", 1), "utf-8")
    assert "records.jsonl" in typed(state, "report", "verify", "site=coastal", code=6)
