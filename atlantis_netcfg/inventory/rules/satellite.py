"""Rules for the satellite: only allowed traffic passes; the router drops the rest, as airtime is expensive.

Also rules for tariffs and caps: they apply only to metered links and must leave room for useful work.
"""

from __future__ import annotations

from ipaddress import IPv4Address
from math import ceil
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _draft, model, satellite_allow_list

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.inventory.findings import Finding

FACTORY_ADDRESS = IPv4Address("192.168.1.1")
"""Reported by technicians for the satellite terminal; also of Teltonika's 4G routers (facts/devices.md, section 3)."""


def only_on_satellites(draft: _draft.Draft) -> Iterator[Finding]:
    """Report `allow` and `refused_probes` on a link that is not a satellite."""
    for name, site in draft.sites.items():
        for index, link in enumerate(site.bearers):
            if link.kind.traits.allow_list:
                continue
            for key, what in (("allow", "an allow-list is"), ("refused_probes", "targets to be refused are")):
                if getattr(link, key):
                    message = msg(f"link `{arg(link.name)}` is {arg(link.kind)}: {arg(what)} for satellites only")
                    yield draft.finding_at(
                        _draft.Part("site", name), ("bearers", index, key), message, msg(f"remove `{arg(key)}:`")
                    )


def refuse_derived_targets(draft: _draft.Draft) -> Iterator[Finding]:
    """Report an `allow` entry that is derived anyway: a fact kept in two places drifts apart."""
    if draft.pilot is None:
        return
    derived_targets = satellite_allow_list.derive_targets(draft.pilot)
    for name, index, link in _satellites(draft):
        for place, target in enumerate(link.allow):
            same = next(
                (allowed_target for allowed_target in derived_targets if _key(allowed_target) == _key(target)), None
            )
            if same is not None:
                target_names = {
                    satellite_allow_list.VPN_TARGET: "the VPN",
                    satellite_allow_list.FAR_END_TARGET: msg(f"the {arg(satellite_allow_list.FAR_END_TARGET)}"),
                }
                what = target_names.get(same.name, msg(f"the time server {arg(same.name)}"))
                message = msg(
                    f"`{arg(link.name)}` always admits {arg(what)}: {arg(_describe_target(target))} needs no entry"
                )
                hint = "remove it; `allow:` contains only additions to the VPN and the time servers"
                yield draft.finding_at(_draft.Part("site", name), ("bearers", index, "allow", place), message, hint)


def each_once(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a destination that is listed twice."""
    for name, index, link in _satellites(draft):
        for key in ("allow", "refused_probes"):
            seen_targets: set[tuple[IPv4Address, int | None, model.Transport]] = set()
            for place, target in enumerate(getattr(link, key)):
                if _key(target) in seen_targets:
                    verb = "admits" if key == "allow" else "probes"
                    message = msg(f"`{arg(link.name)}` {arg(verb)} {arg(target.address)} twice in the same way")
                    yield draft.finding_at(
                        _draft.Part("site", name), ("bearers", index, key, place), message, "remove one"
                    )
                seen_targets.add(_key(target))


def refused_means_refused(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a refused-probe target is outside the allow-list and beyond the link."""
    if draft.pilot is None:
        return
    for name, index, link in _satellites(draft):
        for place, target in enumerate(link.refused_probes):
            path = ("bearers", index, "refused_probes", place)
            if satellite_allow_list.admits(
                satellite_allow_list.allowed_targets(draft.pilot, link), target.address, target.port, target.transport
            ):
                message = msg(
                    f"`{arg(link.name)}` admits {arg(_describe_target(target))}, so a test of it cannot prove that "
                    "traffic is refused"
                )
                hint = "name your own address or port that is not on the allow-list"
                yield draft.finding_at(_draft.Part("site", name), path, message, hint)
            elif target.address in link.network:
                message = msg(f"{arg(target.address)} is in {arg(link.network)}, on this side of the satellite")
                yield draft.finding_at(
                    _draft.Part("site", name), path, message, "name your own address on the other side"
                )


def one_factory_address(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a terminal and a 4G unit of one site that share the factory address."""
    for host, site, terminal in draft.valid_devices(model.SatelliteTerminal):
        if terminal.address != FACTORY_ADDRESS:
            continue
        for other, place, unit in draft.valid_devices(model.LteRouter):
            if place == site and unit.address == FACTORY_ADDRESS:
                where = draft.where(_draft.Part("device", other), "address")
                message = msg(
                    f"`{arg(host)}` and `{arg(other)}` ({arg(where)}) are both at {arg(FACTORY_ADDRESS)}, the factory "
                    "address of both makes"
                )
                hint = "set another network on the web pages of one of them, then enter it here and in `bearers:`"
                yield draft.finding_at(_draft.Part("device", host), ("address",), message, hint)


def evidence_is_whole(draft: _draft.Draft) -> Iterator[Finding]:
    """Require both the backup's file name and its hash, or neither."""
    for host, _, terminal in draft.valid_devices(model.SatelliteTerminal):
        evidence, part = terminal.evidence, _draft.Part("device", host)
        if evidence is None:
            continue
        if (evidence.backup_file is None) != (evidence.backup_sha256 is None):
            missing = "backup_sha256" if evidence.backup_sha256 is None else "backup_file"
            message = msg(f"the evidence of `{arg(host)}` names a backup without `{arg(missing)}`")
            hint = "add it (sha256sum FILE prints the hash), or remove both"
            yield draft.finding_at(part, ("evidence",), message, hint)
        if evidence.backup_file is not None and ("/" in evidence.backup_file or evidence.backup_file.startswith(".")):
            message = msg(f"`{arg(evidence.backup_file)}` is not a plain file name")
            hint = "put the file into the folder evidence/ of the inventory, and write only its name"
            yield draft.finding_at(part, ("evidence", "backup_file"), message, hint)


def _satellites(draft: _draft.Draft) -> Iterator[tuple[str, int, model.Link]]:
    for name, site in draft.sites.items():
        for index, link in enumerate(site.bearers):
            if link.kind.traits.allow_list:
                yield name, index, link


def _key(target: model.AllowedTarget) -> tuple[IPv4Address, int | None, model.Transport]:
    return target.address, target.port, target.transport


def _describe_target(target: model.AllowedTarget) -> str:
    return msg(
        f"{arg(target.address)} port {arg(target.port)} {arg(target.transport)}"
        if target.port
        else f"{arg(target.address)}"
    )


RULES: tuple[_draft.Rule, ...] = (
    only_on_satellites,
    refuse_derived_targets,
    each_once,
    refused_means_refused,
    one_factory_address,
    evidence_is_whole,
)

_PROBE_TARGET_BUDGETS = ("canary_budget_mb", "canary_budget_eur")
_LEAST_MB = 0.1
"""Minimum cap in MB: reading one configured router takes about 80 kB on the wire, before any change."""


def refuse_cost_on_unmetered(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a tariff, cap or budget on an unmetered link."""
    for name, index, link in _links(draft):
        for key in ("billing", "cap_mb", "standing_budget_mb", "standing_budget_eur", *_PROBE_TARGET_BUDGETS):
            if not link.metered and key in link.model_fields_set and getattr(link, key) is not None:
                message = msg(f"link `{arg(link.name)}` is free (`metered: false`), so `{arg(key)}` has no effect")
                hint = msg(f"remove `{arg(key)}:`, or write `metered: true` if every byte costs money")
                yield draft.finding_at(_draft.Part("site", name), ("bearers", index, key), message, hint)


def leaves_room_to_read(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a cap large enough to read one router; below that it would forbid everything."""
    for name, index, link in _links(draft):
        if link.metered and link.cap_mb < _LEAST_MB:
            message = msg(
                f"link `{arg(link.name)}` admits {arg(link.cap_mb):g} MB per action, too little to read one router"
            )
            hint = msg(f"write {arg(_LEAST_MB):g} or more; nothing is sent without consent to the cost")
            yield draft.finding_at(_draft.Part("site", name), ("bearers", index, "cap_mb"), message, hint)


def a_floor_has_a_rate(draft: _draft.Draft) -> Iterator[Finding]:
    """Require `floor_bytes_per_s` where `floor_after_s` is set."""
    for name, index, link in _links(draft):
        billing = link.billing
        if billing is not None and billing.floor_after_s and not billing.floor_bytes_per_s:
            message = msg(
                f"the tariff of link `{arg(link.name)}` has a floor from {arg(billing.floor_after_s)} s on, but no "
                "value for it"
            )
            hint = "add `floor_bytes_per_s` from the contract, or remove `floor_after_s`"
            yield draft.finding_at(
                _draft.Part("site", name), ("bearers", index, "billing", "floor_after_s"), message, hint
            )


def a_budget_in_euro_has_a_tariff(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a tariff in EUR for a budget in EUR: otherwise standing traffic cannot be compared with it."""
    for name, index, link in _links(draft):
        for key in ("standing_budget_eur", "canary_budget_eur"):
            if not link.metered or getattr(link, key) is None:
                continue
            billing, path, in_mb = link.billing, ("bearers", index, key), key.replace("_eur", "_mb")
            if billing is None:
                message = msg(
                    f"link `{arg(link.name)}` has a budget in EUR but no tariff, so the budget cannot be checked"
                )
                hint = msg(f"add `billing:` from the contract, or write `{arg(in_mb)}:`")
                yield draft.finding_at(_draft.Part("site", name), path, message, hint)
            elif billing.currency != "EUR":
                message = msg(
                    f"the tariff of link `{arg(link.name)}` is in {arg(billing.currency)}, but its budget is in EUR"
                )
                yield draft.finding_at(_draft.Part("site", name), path, message, msg(f"write `{arg(in_mb)}:` instead"))


def a_budget_of_probe_targets_is_of_use(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a probe budget has probe targets, and suffices to notice a dead link in time."""
    for name, index, link in _links(draft):
        key = next((key for key in _PROBE_TARGET_BUDGETS if getattr(link, key) is not None), None)
        if not link.metered or key is None:
            continue
        path = ("bearers", index, key)
        if not link.canaries:
            message = msg(f"link `{arg(link.name)}` has a budget for probe targets, but no probe targets")
            yield draft.finding_at(
                _draft.Part("site", name), path, message, msg(f"add `canaries:`, or remove `{arg(key)}:`")
            )
        elif link.probe_target_pause_s > model.LONGEST_PAUSE_S and link.probe_target_budget_bytes is not None:
            least_mb = (
                ceil(link.probe_target_budget_bytes / 1e4 * link.probe_target_pause_s / model.LONGEST_PAUSE_S) / 100
            )
            message = msg(
                f"the probe budget of link `{arg(link.name)}` allows one probe every "
                f"{arg(link.probe_target_pause_s / 60):.0f} min, too few to notice a failure"
            )
            hint = msg(
                f"one probe every {arg(model.LONGEST_PAUSE_S // 60)} min uses {arg(least_mb):.2f} MB a month: set "
                f"`{arg(key)}` to at least that"
            )
            yield draft.finding_at(_draft.Part("site", name), path, message, hint)


def metered_links_have_a_budget(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a budget for the standing traffic of a metered link, which is paid every day."""
    for name, index, link in _links(draft):
        if link.metered and not link.has_standing_budget:
            message = msg(f"there is no budget for the background traffic over {arg(link.name)}")
            yield draft.finding_at(_draft.Part("site", name), ("bearers", index), message, BUDGET_HINT)


BUDGET_HINT = "add `standing_budget_mb:` to the link, or `standing_budget_eur:` if its tariff is in EUR"


def _links(draft: _draft.Draft) -> Iterator[tuple[str, int, model.Link]]:
    for name, site in draft.sites.items():
        for index, link in enumerate(site.bearers):
            yield name, index, link


COST_RULES: tuple[_draft.Rule, ...] = (
    refuse_cost_on_unmetered,
    leaves_room_to_read,
    a_floor_has_a_rate,
    a_budget_in_euro_has_a_tariff,
    a_budget_of_probe_targets_is_of_use,
)
COST_WARNINGS: tuple[_draft.Rule, ...] = (metered_links_have_a_budget,)
