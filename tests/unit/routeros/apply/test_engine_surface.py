"""What other parts may use of the engine and of the journal."""

from atlantis_netcfg import routeros, runs
from atlantis_netcfg.routeros import apply, desired, fleet


def test_public_names_of_the_engine() -> None:
    assert routeros.__all__ == [
        *("DeviceJob", "DeviceResult", "Endpoint", "Estimate", "JobMode", "LinkMetrics", "Patience"),
        *("Status", "converge", "desired", "fleet"),
    ]
    assert (routeros.desired, routeros.fleet) == (desired, fleet), "modules of it, which whoever uses them imports"
    assert all(hasattr(routeros, name) for name in routeros.__all__)
    assert all(hasattr(apply, name) for name in apply.__all__)


def test_public_names_of_the_journal() -> None:
    assert runs.__all__ == sorted(runs.__all__, key=lambda name: (name.lower() == name, not name.isupper(), name))
    assert all(hasattr(runs, name) for name in runs.__all__)


def test_settled_statuses_match_the_engine() -> None:
    assert {status.value for status in routeros.Status} - runs.SETTLED_STATUSES == {"unknown"}
