"""What a transfer takes and costs before it begins, how it stands, and how a command ends by that."""

import json
from typing import Any

import pytest
from retrieval_programs import CENTRE, GATEWAY, KEY, SHIPPED, with_retrieval

from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.computers.retrieval import PACKAGES, SERVICE, retrieval
from atlantis_netcfg.core.errors import ExitCode, NoMatchError, UsageError
from atlantis_netcfg.inventory.model import RetrievalPriority
from atlantis_netcfg.operations import retrieve
from atlantis_netcfg.operations.common.site_links import link_of
from atlantis_netcfg.operations.retrieve_rehearsal import with_example

LOOK = {"files": 4, "bytes": 10_000_000, "compared": 0, "kept": 2, "writing": 1, "unnamed": 0, "before": 1.0}
TOLD = {
    "state": "done",
    "id": "20261126T024000Z",
    "link": "satellite",
    "files": 2,
    "bytes": 1_000_000,
    "arrived": 2,
    "running": False,
    "job": False,
    "wire_bytes": 1_200_000,
    "since": 1000.0,
    "at": 1600.0,
}
DECLARED = with_retrieval()


def planned(link: str, priority: str = "low", **look: Any) -> retrieve.RetrievalPlan:  # noqa: ANN401 - of a look
    declaration = with_retrieval(sources=[{"host": GATEWAY, "priority": priority}])
    return retrieve.plan(declaration, retrieve.source_at(declaration, "coastal", None)[0], link, {**LOOK, **look})


def status(over: str = "satellite", **told: Any) -> retrieve.RetrievalStatus:  # noqa: ANN401 - of a gateway
    return retrieve.RetrievalStatus({**TOLD, **told}, link_of(SHIPPED, "coastal", over))


@pytest.mark.parametrize("priority", list(RetrievalPriority))
def test_rate_is_the_share_of_the_declared_uplink_rate(priority: RetrievalPriority) -> None:
    made = planned("satellite", priority.value)
    assert made.rate_bps == round(retrieve.SHARES[priority] * made.site_link.rate.up_kbps * 1000)
    assert made.seconds >= 8 * made.wire_bytes / made.rate_bps


def test_cost_matches_the_bytes_sent_and_limits_the_job() -> None:
    made = planned("satellite")
    assert made.cost.bill.payload_bytes == made.wire_bytes > 1.2 * LOOK["bytes"]
    job = made.job(retrieve.RetrievalSelection("bag-*"), "number")
    link = link_of(SHIPPED, "coastal", "satellite")
    assert link.cap_bytes is not None
    assert job["cap_bytes"] == min(round(made.wire_bytes * 1.25), link.cap_bytes)
    assert (job["pattern"], job["agreed_bytes"], job["silence_s"]) == ("bag-*", 10_000_000, 120)
    assert planned("satellite", bytes=10**12).cost.over_cap


def test_transfer_over_a_free_link_stops_at_satellite_latency() -> None:
    free, dear = planned("wifi-ptp"), planned("satellite")
    assert free.cap_bytes is None
    slowest = dear.site_link.rate.rtt_ms / 1000
    assert free.rtt_max_s is not None
    assert free.site_link.rate.rtt_ms / 1000 < free.rtt_max_s < slowest
    assert dear.rtt_max_s is None, "nothing is dearer and slower than a satellite"


def test_only_identical_files_at_both_ends_are_green() -> None:
    assert (status().whole, status().exit) == (True, ExitCode.DONE)
    assert status().lines("coastal")[0] == "2 files: the same SHA-256 at both ends"
    for told, code in (
        ({"state": "sending", "running": True}, ExitCode.CHECKS_FAILED),
        ({"state": "waiting", "running": True, "why": "…"}, ExitCode.CHECKS_FAILED),
        ({"left": {"changed": ["bag/a"], "gone": [], "differ": []}, "arrived": 1}, ExitCode.CHECKS_FAILED),
        ({"arrived": 1}, ExitCode.CHECKS_FAILED),
        ({"state": "failed", "left": {"differ": ["bag/a"]}}, ExitCode.FAILED),
        ({"state": "spent"}, ExitCode.FAILED),
        ({"state": "stopped"}, ExitCode.FAILED),
        ({"state": "sending"}, ExitCode.FAILED),
        ({"state": "none"}, ExitCode.NOTHING),
    ):
        found = status(**told)
        assert (found.whole, found.exit) == (False, code), told
        assert found.lines("coastal"), told


def test_transfer_that_ended_silently_is_reported_as_lost() -> None:
    assert status(state="sending").state == "lost"
    assert "ended without notice" in status(state="sending").lines("coastal")[0]
    assert status(state="sending", job=True).state == "sending", "its unit begins again"


def test_cost_is_shown_while_sending_and_at_the_end() -> None:
    on = status(state="sending", running=True, arrived=0)
    assert on.progress() == f"0 of 2 files complete, 1.2 MB sent over satellite, {on.total_cost.money}"
    assert "EUR" in on.total_cost.money
    assert status().lines("coastal")[-1] == f"{status().total_cost.words} over satellite"
    assert "EUR" not in status("wifi-ptp", link="wifi-ptp").lines("coastal")[-1]


def test_source_is_chosen_by_site_or_by_name() -> None:
    assert (
        retrieve.source_at(DECLARED, "coastal", None)[1].name
        == retrieve.source_at(DECLARED, "coastal", GATEWAY)[1].name
        == GATEWAY
    )
    with pytest.raises(UsageError, match="the inventory has no recordings of it at") as near:
        retrieve.source_at(DECLARED, "coastal", "coastal-gatway")
    assert near.value.hint is not None
    assert "from=coastal-gateway" in near.value.hint
    with pytest.raises(UsageError, match="one site at a time"):
        retrieve.source_at(DECLARED, "all", None)
    with pytest.raises(NoMatchError, match="no recordings of te4sea"):
        retrieve.source_at(DECLARED, "te4sea", None)
    with pytest.raises(NoMatchError, match="the inventory has no recordings to retrieve"):
        retrieve.source_at(SHIPPED, "coastal", None)


@pytest.mark.parametrize(("seconds", "text"), [(0.2, "1 s"), (119, "119 s"), (120, "2 min"), (12_000, "3 h 20 min")])
def test_duration_is_formatted_for_people(seconds: float, text: str) -> None:
    assert retrieve.duration(seconds) == text


def test_rehearsal_without_retrieval_config_uses_an_example() -> None:
    declaration, words = with_example(SHIPPED, "te4sea")
    assert words == (
        "the inventory has no recordings to retrieve: this is an example, from te4sea-gateway to scc-control"
    )
    assert retrieve.source_at(declaration, "te4sea", None)[1].name == "te4sea-gateway"
    assert SHIPPED.pilot.retrieval is None
    assert with_example(DECLARED, "coastal") == (DECLARED, None)
    with pytest.raises(NoMatchError, match="scc has no gateway in the VPN"):
        with_example(SHIPPED, "scc")


# What either end of a retrieval gets, and that it goes when it is declared no more.


def test_gateway_gets_the_retrieval_target_and_key() -> None:
    declaration = with_retrieval()
    made = retrieval(declaration, declaration.hosts[GATEWAY])
    files = {file.path: file.content for file in made.files}
    assert json.loads(files["/etc/atlantis/retrieval.json"]) == {
        "from": "10.80.0.21",
        "from_host": GATEWAY,
        "to": CENTRE,
        "address": "10.80.0.2",
        "port": 22,
        "user": "svc-retrieval",
        "key": "/etc/ssh/ssh_host_ed25519_key",
        "sources": {GATEWAY: {"folder": "/var/lib/svc-recording"}},
    }
    assert files["/etc/atlantis/retrieval.known_hosts"] == f"{CENTRE} {KEY}\n"
    unit = files[f"/etc/systemd/system/{SERVICE}"].splitlines()
    assert "ProtectSystem=strict" in unit, "it cannot change a recording"
    assert "ConditionPathExists=/var/lib/atlantis/retrieval/job.json" in unit
    assert [(unit.name, unit.active) for unit in made.units] == [(SERVICE, None)], "a job starts it, no run does"


def test_control_centre_restricts_the_key_to_one_command() -> None:
    declaration = with_retrieval()
    made = retrieval(declaration, declaration.hosts[CENTRE])
    files = {file.path: file.content for file in made.files}
    words = f"/usr/bin/python3 -I /usr/local/lib/atlantis/retrieval_receive.py {GATEWAY} /srv/recordings 1000"
    assert files["/etc/atlantis/retrieval.keys"] == (f'restrict,from="10.80.0.21",command="{words}" {KEY} {GATEWAY}\n')
    assert "Match User svc-retrieval" in files["/etc/ssh/sshd_config.d/50-atlantis-retrieval.conf"]
    assert made.units == ()


def test_each_end_checks_its_declared_host_key() -> None:
    declaration = with_retrieval()
    for name in (GATEWAY, CENTRE):
        (check,) = retrieval(declaration, declaration.hosts[name]).checks
        assert check.run == ("grep", "-qF", f" {KEY.split()[1]}", "/etc/ssh/ssh_host_ed25519_key.pub")
        assert "differs from the inventory" in check.finding
        assert retrieval(declaration, declaration.hosts[name], is_rehearsal=True).checks == ()


def test_retrieval_files_are_removed_when_no_longer_in_inventory() -> None:
    declared = with_retrieval()
    laid = {file.path for name in (GATEWAY, CENTRE) for file in retrieval(declared, declared.hosts[name]).files}
    for name in (GATEWAY, CENTRE, "te4sea-gateway"):
        made = retrieval(SHIPPED, SHIPPED.hosts[name])
        assert (made.files, made.units, made.checks) == ((), (), ())
        assert set(made.absent) == laid


def test_rsync_is_installed_on_both_ends_only() -> None:
    declared = with_retrieval()
    for name, there in ((GATEWAY, True), (CENTRE, True), ("te4sea-gateway", False)):
        packages = {package.name for package in gateway_base(declared, declared.hosts[name]).packages}
        assert (set(PACKAGES) <= packages) is there
