"""Real runs over links that are paid by the byte: asked first, counted, billed, whatever door they come in by."""

import json
from datetime import UTC, datetime
from typing import Any

import pytest
from quay import ROUTER, Quay, fresh_quay

from atlantis_netcfg.routeros.estimate import LinkMetrics, beforehand
from atlantis_netcfg.runs import CostRecord, Store

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

HERE = ("site=coastal", f"device={ROUTER}")
DEAR = (*HERE, "via=satellite")
SATELLITE = LinkMetrics("satellite", 0.7, 352_000, 704_000, is_metered=True)
at = pytest.fixture(fresh_quay)


def connections(at: Quay) -> int:
    return int(at.do("counters")["connections"])


def records(at: Quay) -> list[CostRecord]:
    runs = Store(at.state).runs("coastal")
    return [record for run in runs for record in run.log.records if isinstance(record, CostRecord)]


def test_yes_does_not_consent_to_cost(at: Quay) -> None:
    for typed in ((*DEAR, "--yes"), ("plan", *DEAR), (*DEAR, "--yes", "--json")):
        done = at.provision(*typed, code=4)
        told = done.stderr + done.stdout
        assert "the cost was not accepted, so nothing was sent: over metered link satellite of coastal" in told
        assert "--accept-cost" in told
        assert " EUR" in told
    at.provision("report", "drift", *DEAR, code=4)
    assert connections(at) == 0
    assert not list(at.state.glob("real/coastal/runs/*"))


@pytest.mark.smoke
def test_consented_traffic_is_sent_counted_and_billed(at: Quay) -> None:
    at.twins.do(ROUTER, "link", port="ether3")
    done = at.json(*DEAR, "--yes", "--accept-cost", code=0)
    cost = done["devices"][ROUTER]["cost"]
    sent = done["devices"][ROUTER]["bytes"]
    assert cost["accepted"] is True
    assert (cost["bearer"], cost["declared"]) == ("satellite", "satellite")
    assert cost["bill"]["payload_bytes"] > sent["sent"] + sent["received"]
    assert cost["expected"]["payload_bytes"] == pytest.approx(cost["bill"]["payload_bytes"], rel=0.3)
    assert cost["router"]["interface"] == "ether3"
    assert cost["router"]["bytes"] == pytest.approx(cost["bill"]["payload_bytes"], rel=0.35)
    (record,) = records(at)
    assert (record.bearer, record.accepted, record.price) == ("satellite", True, cost["bill"]["price"])
    again = at.provision(*DEAR, "--yes", "--accept-cost", code=0).stdout
    assert "Traffic: over metered link satellite of coastal: up to" in again
    assert "no changes needed" in again
    # By now the router's own traffic has a better way, and the session with it.
    assert "but its traffic uses wifi-ptp now" in again
    assert "cost over satellite" not in again
    assert len(records(at)) == 1
    usage = Store(at.state).usage("coastal")
    assert (usage.month("satellite", datetime.now(UTC)).bytes or 0) > 0
    assert usage.month("4g", datetime.now(UTC)).bytes == 0


def test_cost_and_changes_need_separate_consent(at: Quay) -> None:
    said_yes = at.typed(*DEAR, answer="yes\nno", code=4)
    assert "Type pay (the whole word) to continue" in said_yes
    assert "nothing was sent" in said_yes
    assert connections(at) == 0
    at.typed(*DEAR, answer="pay\nyes\nno", code=4)
    before = at.export()
    told = at.typed(*DEAR, answer="pay\npay\nno", code=4)
    assert "not confirmed; nothing was changed" in told
    assert at.export() == before
    told = at.typed(*DEAR, answer="pay\npay\nyes", code=0)
    assert "actions applied and verified" in told


def test_wired_link_needs_no_cost_consent(at: Quay) -> None:
    done = at.json(*HERE, "--yes", code=0)
    assert "cost" not in done["devices"][ROUTER]
    assert records(at) == []


def test_run_over_a_metered_fallback_link_is_reported_and_needs_consent(at: Quay) -> None:
    at.configure()
    hide(at, "wifi-ptp")
    at.do("console", words=["/system/identity/set", "=name=changed"])
    over = (*HERE, "via=wifi-ptp")
    refused = at.json(*over, "--yes", code=4)["devices"][ROUTER]
    assert "wifi-ptp is down" in refused["notes"][-1]
    assert "the cost was not accepted: over metered link 4g of coastal" in refused["message"]
    assert "set name=changed" in at.export()
    planned = at.provision("plan", *over, code=2).stdout
    assert "its traffic uses 4g now, which is metered: wifi-ptp is down; over metered link 4g" in planned
    done = at.json(*over, "--yes", "--accept-cost", code=0)["devices"][ROUTER]
    assert (done["cost"]["bearer"], done["cost"]["declared"]) == ("4g", "wifi-ptp")


def hide(at: Quay, bearer: str) -> None:
    """Let the bearer's port lose its carrier, as far as its routes are concerned."""
    port = {"wifi-ptp": "ether1"}[bearer]
    at.do("console", words=["/interface/ethernet/set", f"=numbers={port}", "=disabled=yes"])


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ((), 2, "-e atlantis_accept_cost=true"),
        (("-e", "atlantis_accept_cost=perhaps"), 2, "atlantis_accept_cost is neither true nor false: perhaps"),
        (("-e", "atlantis_accept_cost=true"), 0, "changed=1"),
    ],
)
def test_plain_playbook_needs_cost_consent_too(at: Quay, words: tuple[str, ...], code: int, said: str) -> None:
    file = at.inventory / "host_vars" / f"{ROUTER}.yml"
    text = file.read_text(encoding="utf-8")
    assert "access: {address: 10.64.101.1, " in text
    file.write_text(text.replace("access: {address:", "access: {via: satellite, address:"), encoding="utf-8")
    done = at.playbook(*words, "--check")
    assert done.returncode == code, done.stdout + done.stderr
    assert said in done.stdout + done.stderr
    assert (connections(at) == 0) == (code != 0)


def test_rehearsal_shows_the_cost_consent_of_a_real_run(at: Quay) -> None:
    done = at.provision(*HERE, "--rehearse", code=0).stdout
    lines = done.splitlines()
    over = next(number for number, line in enumerate(lines) if "second run over satellite" in line)
    assert "a real run needs your consent: over metered link satellite of coastal: about" in lines[over + 1]
    assert lines[over + 2].strip().startswith("and costs: ")
    told: dict[str, Any] = json.loads(at.provision(*HERE, "--rehearse", "--json", code=0).stdout)
    bearers = told["devices"][ROUTER]["bearers"]
    assert "cost" not in bearers["lan"]
    assert bearers["satellite"]["cost"]["expected"]["price"] is not None
    assert bearers["4g"]["cost"]["expected"]["price"] is None
    # What is told before anything was read must not be less than what reading a configured router comes to.
    before = beforehand(SATELLITE).wire_bytes
    assert before == pytest.approx(bearers["satellite"]["cost"]["bill"]["payload_bytes"], rel=0.15)
    assert before >= bearers["satellite"]["cost"]["bill"]["payload_bytes"]
