"""Listening over links that are all paid by the byte asks for consent; at the site, or over a free one, nobody does."""

from collections.abc import Callable

import pytest
import robot_cases
from hints_said import advised

from atlantis_netcfg.cli import main
from atlantis_netcfg.operations import robots
from atlantis_netcfg.operations.robots import remote
from atlantis_netcfg.operations.robots.listening_cost import listening_cost
from atlantis_netcfg.robots.observation import RobotObservation

VPN, LAN = "10.80.1.7", "10.64.2.50"
LISTEN = ["robot", "discover", "site=te4sea"]


@pytest.fixture
def listened(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[str]]:
    """Where it listened, once this computer's address is chosen."""
    places: list[str] = []

    def choose(address: str) -> list[str]:
        monkeypatch.setattr(robots, "listening_address", lambda *_: address)
        return places

    def here(*_: object) -> tuple[RobotObservation, list[object]]:
        places.append("here")
        return RobotObservation(5.0), []

    def there(_declaration: object, host: object, *_: object, **_more: object) -> RobotObservation:
        places.append(str(getattr(host, "name", "")))
        return RobotObservation(5.0)

    monkeypatch.setattr(robots, "discover", here)
    monkeypatch.setattr(remote, "listen_there", there)
    return choose


def test_listening_from_the_vpn_requires_consent(
    listened: Callable[[str], list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    places = listened(VPN)
    assert main(LISTEN) == 4
    printed = capsys.readouterr().err
    assert "the cost was not accepted, so nothing was sent: over metered link 4g of te4sea" in printed
    assert "run the same command with `--accept-cost`, or listen at the site: `from=te4sea-gateway`" in printed
    assert not places
    assert main([*LISTEN, "--accept-cost"]) == 6
    assert main([*LISTEN, "from=te4sea-gateway"]) == 6
    assert main([*LISTEN, "from=scc-control"]) == 4
    assert places == ["here", "te4sea-gateway"]


def test_cost_above_the_cap_cannot_be_accepted(
    listened: Callable[[str], list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    places = listened(VPN)
    assert main([*LISTEN, "for=60m", "--accept-cost"]) == 4
    printed = capsys.readouterr().err
    assert "the limit for one action is" in printed
    assert "--accept-cost" not in printed
    assert advised(printed) == []
    assert not places


def test_listening_at_the_site_or_over_a_free_link_needs_no_consent(listened: Callable[[str], list[str]]) -> None:
    places = listened(LAN)
    assert main(LISTEN) == 6
    listened(VPN)
    assert main(["robot", "discover", "site=coastal"]) == 6
    assert places == ["here", "here"]


def test_cost_counts_configurations_of_expected_robots() -> None:
    shipped = robot_cases.shipped()
    cost = listening_cost(shipped, "te4sea", 60, lambda: VPN)
    assert cost is not None
    sources, _ = robots.robots_of(shipped)
    here = [each for each in sources if each.vehicle in robots.expected_at(shipped, "te4sea")]
    configurations = 60 * sum(each.size for each in here)
    assert configurations < cost.bill.payload_bytes < configurations + 2_000_000
    assert listening_cost(shipped, "te4sea", 60, lambda: "127.0.0.1") is None
