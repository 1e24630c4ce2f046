"""What must be true of a device before anything of a plan can be sent to it; all that is missing is said at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.routeros._types import Facts, Observed, Plan

POLICIES = ("read", "write", "policy", "test", "sensitive", "api")
"""What our user's group must be allowed: without `sensitive` a secret reads as empty, and would be written again."""

_CERTIFICATES = "/certificate"
_TUNNEL = "/interface/ovpn-client"
_INSTALL = "type `provision vpn install host={}` first"
_NO_CERTIFICATE = ("", "none", "auto")
_FEATURES = {"/ip/proxy": "proxy", "/ip/socks": "socks", "/tool/bandwidth-server": "bandwidth-test"}
"""Menus that device-mode can forbid (manual, Device-mode)."""


def missing(plan: Plan, observed: Observed) -> tuple[str, ...]:
    """Return what the device or our user lacks for this plan."""
    facts = observed.facts
    return (*_policies(facts), *_certificates(plan, observed), *_features(plan, facts))


def _policies(facts: Facts) -> Iterator[str]:
    if not facts.policies:
        yield "the device does not tell what our user may do: it must be a local user with policy `policy`"
        return
    lacking = [policy for policy in POLICIES if policy not in facts.policies]
    if lacking:
        yield f"our user may not {', '.join(lacking)}: its group needs these policies"


def _certificates(plan: Plan, observed: Observed) -> Iterator[str]:
    if _CERTIFICATES not in observed.rows:
        return
    there = {row.get("name") for row in observed.rows[_CERTIFICATES]}
    for action in plan.actions:
        name = dict(action.values).get("certificate", "")
        if name not in _NO_CERTIFICATE and name not in there:
            needs = f"{MENUS[action.menu].title} needs certificate {name}, which is not on the device"
            yield f"{needs}: {_INSTALL.format(plan.device) if action.menu == _TUNNEL else 'import it first'}"


def _features(plan: Plan, facts: Facts) -> Iterator[str]:
    for action in plan.actions:
        feature = _FEATURES.get(action.menu)
        desired = dict(action.values).get("enabled") in ("yes", "true")
        if feature is not None and desired and facts.device_mode.get(feature) in ("false", "no"):
            yield (
                f"device-mode {facts.device_mode.get('mode', '')} forbids {feature}: allow it with"
                f" /system device-mode update {feature}=yes and press the button"
            )
