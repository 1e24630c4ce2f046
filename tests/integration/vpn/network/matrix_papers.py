"""Who shall be in a stand's VPN, and what the product hands out to them."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.model import Gateway, VpnServer
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.authority.model import EnrolmentFile, EnrolmentRequest, ServerNames
from atlantis_netcfg.vpn.client import CONF, IDENTITY, openvpn_client, site_link
from atlantis_netcfg.vpn.enrolment_package.profile import identity_file, profile
from atlantis_netcfg.vpn.identity import Identity, MemberKind

_PASSPHRASE = Secret("a long passphrase of this test alone")


def issued(declaration: Inventory, wishes: Sequence[EnrolmentRequest], folder: Path) -> Authority:
    """An authority with these members; each one's configuration is `NAME.ovpn` of the folder."""
    pilot, server = declaration.pilot.vpn, declaration.hosts[declaration.pilot.vpn.server]
    assert isinstance(server.device, VpnServer)
    names = ServerNames(server.name, (pilot.endpoint_name,), (pilot.endpoint, server.device.address))
    authority = Authority.init(folder / "authority", _PASSPHRASE, names, "test", sealed_by="vault")
    with authority.unlock(lambda: _PASSPHRASE, "test") as signer:
        signer.issue(list(wishes), lambda identity: _deliver(declaration, folder, identity))
    return authority


def _deliver(declaration: Inventory, folder: Path, identity: Identity) -> EnrolmentFile:
    """A gateway's own configuration, everybody else's profile."""
    name = identity.member.name
    path, declared = folder / f"{name}.ovpn", declaration.hosts.get(name)
    if declared is not None and isinstance(declared.device, Gateway):
        key = folder / f"{name}.identity"
        write(key, identity_file(identity).reveal())
        files = openvpn_client(declaration, declared, key).configuration.files
        write(path, next(one.content for one in files if one.path == CONF).replace(IDENTITY, str(key)))
    else:
        write(path, profile(declaration, identity).reveal())
    return EnrolmentFile(str(path), hashlib.sha256(path.read_bytes()).hexdigest())


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    path.chmod(0o600)


def host(declaration: Inventory, name: str) -> EnrolmentRequest:
    """A declared host, with its declared address."""
    device = declaration.hosts[name].device
    client = getattr(device, "vpn_client", None)
    address = client.address if client else device.vpn_address  # type: ignore[union-attr]
    return EnrolmentRequest(
        name, MemberKind.HOST, None, name, address=address, link=site_link(declaration, declaration.hosts[name].site)
    )


def guest(
    declaration: Inventory, partner: str, device: str, kind: MemberKind, vehicle: str | None = None
) -> EnrolmentRequest:
    """A partner's device, with the next address of its pool."""
    pool = declaration.partners[partner].vpn_pool
    return EnrolmentRequest(f"{partner}-{device}", kind, partner, device, pool=pool, vehicle=vehicle)
