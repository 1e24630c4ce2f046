"""What `provision links use` takes, what it refuses, and what it says of the cost."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import yaml

from atlantis_netcfg.core.errors import TRUST, NetcfgError, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import load
from atlantis_netcfg.links import LinkFinding, LinkState, LinkStatus
from atlantis_netcfg.operations.common.kinds import is_supported
from atlantis_netcfg.operations.common.site_links import link_named, link_of
from atlantis_netcfg.operations.links.collect import LinksStatus
from atlantis_netcfg.operations.links.status import Silent
from atlantis_netcfg.operations.use import LinkNotFit, NothingInUse, UseRequest, ended_order, router_of, span_s
from atlantis_netcfg.routeros.link_use import LinkUse, in_use

DECLARED = load(Path(__file__).parents[4] / "inventory")
NOW = datetime(2026, 11, 25, 20, 0, 31, tzinfo=UTC)


def status(state: LinkState = LinkState.UP, uptime_s: float | None = 500.0, use: LinkUse | None = None) -> LinksStatus:
    down = () if state is LinkState.UP else (LinkFinding(Verdict.FAIL, "silent", "no probe target responds", "look"),)
    bearers = tuple(
        LinkStatus(
            name=bearer.name,
            kind=bearer.kind.value,
            state=state,
            active=None,
            is_metered=True,
            quality={},
            month_bytes=None,
            findings=down,
        )
        for bearer in DECLARED.sites["coastal"].bearers
    )
    return LinksStatus(
        links=bearers,
        boxes={},
        months={},
        probe_bytes={},
        unreachable=(),
        not_asked={},
        round_trips={},
        queried_devices=(),
        bills={},
        standing={},
        uptime_s=uptime_s,
        use=use,
    )


def wanted(link: str = "4g", for_s: int = 1800, *, unproved: bool = False) -> UseRequest:
    return UseRequest("coastal", link_named(DECLARED, "coastal", link), for_s, unproved)


@pytest.mark.parametrize(
    ("text", "seconds"), [("1m", 60), ("30m", 1800), ("2h", 7200), ("1h30m", 5400), ("24h", 86400)]
)
def test_accepted_durations(text: str, seconds: int) -> None:
    assert span_s(text) == seconds


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0m", "is less than 1 minute"),
        ("25h", "is more than 24 hours"),
        ("24h1m", "is more than 24 hours"),
        ("30", "is not a duration"),
        ("30s", "is not a duration"),
        ("half", "is not a duration"),
    ],
)
def test_refused_durations(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words) as refused:
        span_s(text)
    assert "`for=30m`" in str(refused.value.hint)


@pytest.mark.parametrize(
    ("ask", "message", "hint"),
    [
        (lambda: router_of(DECLARED, "scc"), "`uplink` is its only link", "add a second link in group_vars/scc.yml"),
        (lambda: router_of(DECLARED, "all"), "this command changes the link of one site", "sites: "),
        (
            lambda: router_of(DECLARED, "costal"),
            "this command changes the link of one site",
            "did you mean `site=coastal`?",
        ),
        (
            lambda: link_named(DECLARED, "coastal", "satelite"),
            "has no link `satelite`",
            "did you mean `link=satellite`?",
        ),
        (lambda: wanted().order(status(uptime_s=None)), "could not be read", "`provision links site=coastal`"),
        (lambda: wanted().order(status(uptime_s=20)), "started 20 s ago", "again in 100 s"),
        (lambda: wanted().order(status(LinkState.DOWN)), "4g is down, .*: no probe target responds", "--unproved"),
        (lambda: wanted().order(status(LinkState.SEARCHING)), "4g is down", "--unproved"),
        (lambda: wanted().order(status(LinkState.UNKNOWN)), "there is no proof that 4g works", "--unproved"),
        (lambda: ended_order("coastal", status()), "there is nothing to end", "`provision links site=coastal`"),
        (lambda: ended_order("coastal", status(uptime_s=None)), "could not be read", "`provision links site=coastal`"),
    ],
)
def test_invalid_requests_are_refused(ask: Callable[[], object], message: str, hint: str) -> None:
    with pytest.raises(NetcfgError, match=message) as refused:
        ask()
    assert hint in str(refused.value.hint)


def test_refusals_have_their_exit_codes() -> None:
    assert (LinkNotFit("").exit, NothingInUse("").exit, UsageError("").exit) == (4, 7, 3)


def test_end_uses_router_uptime_and_the_clock_of_this_computer() -> None:
    order = wanted(for_s=3600).order(status(), NOW)
    assert (order.link, order.since_uptime_s, order.until_uptime_s, order.proved) == ("4g", 500, 4100, True)
    assert order.until == datetime(2026, 11, 25, 21, 0, tzinfo=UTC)
    assert not wanted(unproved=True).order(status(LinkState.UNKNOWN), NOW).proved


@pytest.mark.parametrize("age_s", [0, 3600])
def test_link_with_a_recent_vpn_proof_is_accepted(age_s: int) -> None:
    order = wanted("satellite").order(status(LinkState.UNKNOWN), NOW, proof=NOW - timedelta(seconds=age_s))
    assert (order.link, order.proved) == ("satellite", True)


@pytest.mark.parametrize(
    ("state", "age_s"),
    [(LinkState.UNKNOWN, 3601), (LinkState.UNKNOWN, -1), (LinkState.DOWN, 0), (LinkState.SEARCHING, 0)],
)
def test_old_or_contradicted_proof_is_refused(state: LinkState, age_s: int) -> None:
    with pytest.raises(LinkNotFit):
        wanted("satellite").order(status(state), NOW, proof=NOW - timedelta(seconds=age_s))


def test_link_without_probe_targets_is_refused_with_a_hint() -> None:
    with pytest.raises(LinkNotFit) as refused:
        wanted().order(status(LinkState.UNKNOWN))
    assert "set two `canaries:` (probe targets) for it in group_vars/coastal.yml" in str(refused.value.hint)


def test_cost_is_the_maximum_at_the_declared_rate() -> None:
    cost = wanted("satellite", 600).cost(link_of(DECLARED, "coastal", "satellite"))
    rate = DECLARED.sites["coastal"].bearers[-1].rate
    assert cost.bill.payload_bytes == round((rate.up_kbps + rate.down_kbps) * 1000 / 8 * 600)
    assert "up to" in cost.words
    assert "EUR" in cost.words


def test_link_use_round_trips_through_its_comment() -> None:
    use = LinkUse("4g", datetime(2026, 11, 25, 21, 0, tzinfo=UTC), 4100)
    assert in_use([{"name": "atlantis-use", "comment": use.comment}]) == use
    assert in_use([{"name": "somebody", "comment": use.comment}]) is None
    assert in_use([{"name": "atlantis-use", "comment": "atlantis: something else"}]) is None
    assert "(60 min left)" in use.words(500)
    assert "(7 s left)" in use.words(4093)
    assert "left" not in replace(use).words(None).partition(", by")[0]


ROOT = Path(__file__).parents[4]


def test_every_supported_host_is_in_a_play_with_the_role() -> None:
    plays = yaml.safe_load((ROOT / "playbooks/site.yml").read_text(encoding="utf-8"))
    patterns = [play["hosts"] for play in plays for task in play["tasks"] if "ansible.builtin.import_role" in task]
    groups = {group for pattern in patterns for group in pattern.split(":")}
    inventory = yaml.safe_load((ROOT / "inventory/hosts.yml").read_text(encoding="utf-8"))["all"]["children"]
    hosts = {name for group in groups & inventory.keys() for name in inventory[group]["hosts"]}
    found = {host.name for host in load(ROOT / "inventory").hosts.values() if is_supported(host)}
    assert found
    assert found <= hosts


def test_untrusted_router_hint_advises_to_trust_it() -> None:
    unknown = replace(status(uptime_s=None), unreachable=(Silent("coastal-router", "unknown here", TRUST),))
    with pytest.raises(LinkNotFit) as begun:
        wanted().order(unknown)
    with pytest.raises(LinkNotFit) as ended:
        ended_order("coastal", unknown)
    assert begun.value.hint == ended.value.hint == TRUST.replace("site=…", "site=coastal")
