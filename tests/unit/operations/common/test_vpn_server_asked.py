"""The server of the VPN in a run: what its role is told, and what is refused before anything is contacted."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.common.request import Mode, Request, Target
from atlantis_netcfg.operations.computers._access import is_computer
from atlantis_netcfg.operations.computers.desired_state import perform
from atlantis_netcfg.operations.computers.parts import PARTS, concerns, require_authority
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.authority.model import ServerNames

SHIPPED = Path(__file__).parents[4] / "inventory"
SERVER, GATEWAY = "scc-vpn", "coastal-gateway"


def ask(state: Path, part: str, **asked: Any) -> Mapping[str, Any]:  # noqa: ANN401 - of a request
    request = Request(state=state, rehearsed=True, **asked).model_dump(mode="json")
    told = perform(SHIPPED, [SERVER, GATEWAY, "scc-router"], request, part, plan_only=False)
    per_host: Mapping[str, Any] = told["per_host"]
    return per_host


@pytest.fixture
def founded(tmp_path: Path) -> Path:
    """A state folder with an authority."""
    Authority.init(
        tmp_path / "vpn",
        Secret("six words that a die has chosen"),
        ServerNames(SERVER, ("vpn.example.org",), ()),
        "tester",
        "vault",
    )
    return tmp_path


def test_each_role_gets_secrets_of_its_own_hosts_only(founded: Path) -> None:
    target = Target(host="127.0.0.1", port=2222, known_hosts="/k", identity="/i")
    reached = ask(founded, "computer_access", targets={SERVER: target})
    assert reached.keys() == {SERVER, GATEWAY}
    assert (reached[SERVER]["port"], reached[SERVER]["user"]) == (2222, "root")
    assert ask(founded, "openvpn_server").keys() == {SERVER}
    assert ask(founded, "gateway_base").keys() == {GATEWAY}
    hosts = [host for host in load(SHIPPED).hosts.values() if is_computer(host)]
    assert all(any(concerns(part, host) for host in hosts) for part in PARTS)


def test_without_an_authority_the_server_is_refused_and_gateways_are_not(tmp_path: Path) -> None:
    with pytest.raises(UsageError) as refused:
        ask(tmp_path, "computer_access")
    assert refused.value.exit is ExitCode.USAGE
    assert "provision vpn init" in (refused.value.hint or "")
    gateways = [load(SHIPPED).hosts[GATEWAY]]
    require_authority(gateways, Request(state=tmp_path, mode=Mode.DRIFT))


def test_another_authority_folder_can_be_given(founded: Path) -> None:
    told = ask(founded / "empty", "openvpn_server", authority=founded / "vpn")
    assert set(told[SERVER]["secrets"].values()) == {
        str(founded / "vpn" / "server" / name) for name in ("server.key", "tls-crypt-v2.key", "tls-crypt.key")
    }


def test_offline_bundle_is_refused_for_the_vpn_server(founded: Path) -> None:
    with pytest.raises(UsageError, match="the VPN server does not use a bundle") as refused:
        ask(founded, "computer_access", offline=founded)
    assert "without `--offline`" in (refused.value.hint or "")
