from __future__ import annotations

import atlantis_netcfg.emulator.routeros as package
from atlantis_netcfg.emulator.routeros import RouterLink, RouterSpec, SiteSpec, TwinSpec


def test_the_public_surface_is_what_it_says() -> None:
    assert set(package.__all__) == {
        *("COMMANDS", "NOT_REHEARSED", "Air", "Called", "CellSpec", "WireCounters", "Deviation", "Device"),
        *("DeviceMode", "Environment", "Execute", "LinkFault", "FaultKind", "RouterLink", "Load"),
        *("ManagementSpec", "DeviceModeName", "ModemSpec", "Radio", "RadioLink", "RadioPair", "EmulatedRouter"),
        *("RouterSpec", "RunningSite", "Service", "SimSpec", "EmulatedSite", "SiteSpec", "SpawnedSite"),
        *("TrafficCounters", "TwinRefused", "TwinSpec", "TwinsFailed", "User", "Validity"),
        *("WireBehaviour", "spawn"),
    }
    assert all(hasattr(package, name) for name in package.__all__)


def test_a_site_survives_json() -> None:
    twin = TwinSpec(
        router=RouterSpec(name="router"), link=RouterLink(delay_s=0.35, rate_up_bps=176_000), ports={8729: 18729}
    )
    site = SiteSpec(name="coastal", twins=(twin,))
    assert SiteSpec.model_validate_json(site.model_dump_json()) == site
