"""`provision links` on a real address: pins, vault, consent, the counters of a month, and nothing changed."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from quay import PROVISION, ROUTER, Quay, quay

from atlantis_netcfg.runs import Store

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

ONLY = ("site=coastal", f"device={ROUTER}")
NOT_ASKED = 6
"""What a look ends with here: no resolver is in this network, so a name of the allow-list cannot be asked for."""


@pytest.fixture(scope="module")
def berth(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Quay]:
    """A router as declared."""
    with quay(tmp_path_factory.mktemp("quay")) as opened:
        opened.configure()
        yield opened


@pytest.mark.smoke
def test_links_reads_and_changes_nothing(berth: Quay) -> None:
    before, entries = berth.export(), berth.do("console", words=["/system/history/print"])
    berth.do("reset")
    told = berth.json("links", *ONLY, code=NOT_ASKED)
    assert berth.do("counters")["turns"] <= 4
    assert told["round_trips"] == {ROUTER: 5}
    assert [one["state"] for one in told["bearers"].values()] == ["up", "up", "unknown"]
    assert [one["active"] for one in told["bearers"].values()] == [True, False, False]
    assert set(told["not_asked"]) == {"coastal-cpe", "scc-cpe", "coastal-4g", "coastal-sat"}
    assert (berth.export(), berth.do("console", words=["/system/history/print"])) == (before, entries)
    assert len(berth.runs()) == 1


def test_unresolved_allow_list_names_are_a_finding(berth: Quay) -> None:
    findings = berth.json("links", *ONLY, code=NOT_ASKED)["bearers"]["satellite"]["findings"]
    assert ("INCONCLUSIVE", "allow-list-name-not-asked") in {(one["verdict"], one["code"]) for one in findings}


def test_monthly_usage_grows_with_the_counters(berth: Quay) -> None:
    first, second = (berth.json("links", *ONLY, code=NOT_ASKED)["bearers"]["4g"] for _ in range(2))
    assert first["month_bytes"] < second["month_bytes"]
    assert first["month_since"] == second["month_since"]
    kept = Store(berth.state).usage("coastal").last("4g")
    assert kept is not None
    assert (kept.device, kept.interface) == (ROUTER, "ether2")


def test_unreachable_devices_are_findings(berth: Quay) -> None:
    told = berth.json("links", "site=coastal", code=6)
    assert {one["device"] for one in told["unreachable"]} == {"coastal-cpe", "scc-cpe", "coastal-4g"}
    assert {one["code"] for one in told["bearers"]["wifi-ptp"]["findings"]} == {"device-unreachable"}
    assert told["bearers"]["wifi-ptp"]["state"] == "up"


def test_links_ignores_the_site_lock(berth: Quay) -> None:
    with Store(berth.state).lock("coastal", "somebody else's run"):
        berth.provision("links", *ONLY, code=NOT_ASKED)


def test_metered_link_needs_consent_before_anything_is_sent(berth: Quay) -> None:
    berth.do("reset")
    refused = berth.provision("links", *ONLY, "via=4g", code=4)
    assert "--accept-cost" in refused.stderr
    assert berth.do("counters")["turns"] == 0
    agreed = berth.provision("links", *ONLY, "via=4g", "--accept-cost", code=NOT_ASKED)
    assert "over metered link 4g of coastal" in agreed.stdout
    assert berth.do("counters")["turns"] > 0


def test_no_device_is_contacted_without_the_vault_password(berth: Quay) -> None:
    environment = berth.environment()
    del environment["ANSIBLE_VAULT_PASSWORD_FILE"]
    berth.do("reset")
    done = subprocess.run(
        [PROVISION, "links", *ONLY, f"inventory={berth.inventory}"],
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 3, done.stdout + done.stderr
    assert "vault" in done.stderr
    assert berth.do("counters")["turns"] == 0


def test_device_with_another_certificate_is_not_logged_in_to(tmp_path: Path) -> None:
    with quay(tmp_path) as at:
        at.adopt()
        at.replace("stranger")
        told = at.json("links", *ONLY, code=6)
        assert [one["device"] for one in told["unreachable"]] == [ROUTER]
        assert "the certificate is not the one of this device" in told["unreachable"][0]["message"]
        assert {one["active"] for one in told["bearers"].values()} == {None}
        assert at.do("counters")["turns"] == 0
