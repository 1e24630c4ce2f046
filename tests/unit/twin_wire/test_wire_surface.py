from __future__ import annotations

import atlantis_netcfg.emulator.routeros as package
from atlantis_netcfg.emulator.routeros import Link, RouterSpec, SiteSpec, TwinSpec


def test_the_public_surface_is_what_it_says() -> None:
    assert set(package.__all__) == {
        "COMMANDS",
        "NOT_REHEARSED",
        "Air",
        "Called",
        "CellSpec",
        "Counters",
        "Deviation",
        "Device",
        "DeviceMode",
        "Environment",
        "Execute",
        "Fault",
        "FaultKind",
        "Link",
        "Load",
        "Management",
        "Mode",
        "ModemSpec",
        "Radio",
        "RadioLink",
        "RadioPair",
        "Router",
        "RouterSpec",
        "RunningSite",
        "Service",
        "SimSpec",
        "Site",
        "SiteSpec",
        "SpawnedSite",
        "TrafficCounters",
        "TwinRefused",
        "TwinSpec",
        "TwinsFailed",
        "User",
        "Validity",
        "WireBehaviour",
        "spawn",
    }
    assert all(hasattr(package, name) for name in package.__all__)


def test_a_site_survives_json() -> None:
    twin = TwinSpec(router=RouterSpec(name="router"), link=Link(delay_s=0.35, rate_up_bps=176_000), ports={8729: 18729})
    site = SiteSpec(name="coastal", twins=(twin,))
    assert SiteSpec.model_validate_json(site.model_dump_json()) == site
