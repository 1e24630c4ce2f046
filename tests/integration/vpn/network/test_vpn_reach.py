"""Who reaches whom through a real OpenVPN is what `policy.allows` says, for every ordered pair and every protocol.

Server, a site's router with its LAN and technician, a gateway, the control centre, two partners with two devices each,
of which one sees the other's robot. Every file of OpenVPN and the firewall is the product's.
"""

import socket
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from matrix_checks import BESIDE_ALL, CHECKS, GATEWAY, LAPTOP, UDP_PORTS, ZARCO, Reach, matrix
from matrix_papers import guest, host
from matrix_probe import Probes
from matrix_stand import CENTRE, ROUTER, SERVER, vpn
from waiting import HANG_S

from atlantis_netcfg.inventory import load
from atlantis_netcfg.vpn import server as product
from atlantis_netcfg.vpn.identity import CertificateStatus, MemberKind, MembershipList
from atlantis_netcfg.vpn.policy import TABLE, policy

pytestmark = [pytest.mark.namespace, pytest.mark.slow]
SHIPPED = Path(__file__).parents[4] / "inventory"


@pytest.fixture(scope="module")
def reach(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reach]:
    shipped = load(SHIPPED)
    partners = {name: shipped.partners[name] for name in ("inesc", "iqua")}
    partners["inesc"] = partners["inesc"].model_copy(update={"sees": ("sparus",)})
    declaration = replace(shipped, partners=partners)
    wishes = [host(declaration, name) for name in (ROUTER, GATEWAY, CENTRE)]
    for partner, vehicle in (("inesc", "zarco"), ("iqua", "sparus")):
        wishes.append(guest(declaration, partner, "laptop", MemberKind.LAPTOP))
        wishes.append(guest(declaration, partner, vehicle, MemberKind.ROBOT, vehicle))
    with vpn(declaration, wishes, tmp_path_factory.mktemp("vpn")) as made:
        membership = made.authority.membership()
        ends = {name: str(member.address) for name, member in membership.members.items()} | BESIDE_ALL
        yield Reach(made, Probes(made, ends, UDP_PORTS), policy(declaration, membership))


@pytest.mark.smoke
def test_members_reach_only_what_they_may(reach: Reach) -> None:
    """One test, so that two workers of xdist do not make a stand each."""
    for check in CHECKS:
        check(reach)
    _cut_in_the_middle(reach)


def _cut_in_the_middle(reach: Reach) -> None:
    """Who is taken from the members is: nothing is flushed, his tunnel is still up, and all others go on."""
    made, membership = reach.made, reach.made.authority.membership()
    listening = made.socket(ZARCO, socket.AF_INET, socket.SOCK_STREAM)
    listening.bind((reach.probes.ends[ZARCO], 2222))
    listening.listen()
    client = made.socket(LAPTOP, socket.AF_INET, socket.SOCK_STREAM)
    client.settimeout(HANG_S)
    client.connect((reach.probes.ends[ZARCO], 2222))
    server, _ = listening.accept()
    without = _revoked(membership, ZARCO)
    with server:
        client.sendall(b"one")
        assert server.recv(100) == b"one"
        made.load(without)
        before = made.counter("p_denied")
        client.sendall(b"two")
        server.sendall(b"three")
        assert reach.probes.wait(lambda: made.counter("p_denied") >= before + 2)
        for end in (client, server):
            end.setblocking(False)
            with pytest.raises(BlockingIOError):
                end.recv(100)
            end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        client.close()
    matrix(reach, policy(made.declaration, without), others=20)  # the connection that was cut is repeated, and reset
    made.load(membership)


def _revoked(membership: MembershipList, name: str) -> MembershipList:
    member = membership.members[name]
    dead = tuple(replace(one, standing=CertificateStatus.REVOKED) for one in member.certificates)
    return replace(membership, members={**membership.members, name: replace(member, certificates=dead)})


@pytest.mark.campaign
def test_removed_firewall_line_is_detected(reach: Reach) -> None:
    """Without any one of its lines the firewall does something else; tests/unit/vpn/policy asks the text the same."""
    made = reach.made
    lines = made.placed(product.FIREWALL).read_text(encoding="utf-8").splitlines()
    reach.probes.patience_s = 2.0
    tried, survivors = 0, []
    for index, line in enumerate(lines):
        if line.strip() and not line.strip().startswith("#"):
            tried += 1
            if not _killed(reach, "\n".join([*lines[:index], *lines[index + 1 :]])):
                survivors.append(f"{index + 1}: {line.strip()}")
    made.load()
    print(f"{tried} lines, survivors:", *survivors, sep="\n")  # noqa: T201 - what a campaign is for
    assert len(survivors) <= tried // 10, survivors


def _killed(reach: Reach, mutant: str) -> bool:
    """Loaded twice, so that it is missed if a table is added to instead of replaced."""
    made = reach.made
    made.run(SERVER, "nft", "delete", "table", "inet", TABLE)
    inside = ["ip", "netns", "exec", made.name(SERVER), "nft", "-f", "-"]
    for _ in range(2):
        if subprocess.run(inside, input=f"{mutant}\n", text=True, capture_output=True, check=False).returncode:
            made.load()
            return True
    once = made.run(SERVER, "nft", "list", "table", "inet", TABLE)
    if once.count("goto p_deny") > mutant.count("goto p_deny"):
        return True
    try:
        for check in CHECKS:
            check(reach)
    except (AssertionError, pytest.fail.Exception, OSError):
        return True
    return False
