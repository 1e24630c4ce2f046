"""DDS through the VPN: who hears whom is what the policy says, though each announces itself to everybody.

Real participants of Cyclone DDS, our hosts' with the profile of `provision robot dds`, partners' with one of their own.
"""

import itertools
import subprocess
import sys
import threading
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path

import pytest
from matrix_papers import guest, host
from matrix_stand import CENTRE, Vpn, vpn
from waiting import wait_until

from atlantis_netcfg.computers.dds import profile_views, profiles
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import DdsPeer
from atlantis_netcfg.vpn.identity import MemberKind
from atlantis_netcfg.vpn.policy import Flow, Party, Protocol, policy

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)
pytestmark = [pytest.mark.namespace, pytest.mark.slow]
SHIPPED = Path(__file__).parents[4] / "inventory"
PROGRAM = Path(__file__).parents[2] / "computers" / "dds" / "programs" / "python_peer.py"
GATEWAY = "coastal-gateway"
_DDS = Flow(Protocol.UDP, 7410)
_OWN = """\
<CycloneDDS><Domain Id="any">
  <General>
    <Interfaces><NetworkInterface address="{own}" multicast="false"/></Interfaces>
    <AllowMulticast>false</AllowMulticast><MaxMessageSize>1200B</MaxMessageSize>
  </General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>9</MaxAutoParticipantIndex>
    <SPDPInterval>1s</SPDPInterval><Peers>{peers}</Peers>
  </Discovery>
</Domain></CycloneDDS>
"""


@dataclass
class Ear:
    """What a participant has heard, by the name of who said it."""

    words: dict[str, int] = field(default_factory=dict)

    def listen(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                if " got " in line:
                    said = line.partition(" got ")[2].split()[0]
                    self.words[said] = self.words.get(said, 0) + 1


def test_dds_reaches_only_permitted_parties(tmp_path: Path) -> None:
    shipped = load(SHIPPED)
    inesc = shipped.partners["inesc"].model_copy(update={"sees": ("sparus",)})
    declaration = replace(shipped, partners={**shipped.partners, "inesc": inesc})
    wishes = [host(declaration, GATEWAY), host(declaration, CENTRE)]
    for partner, vehicle in (("inesc", "zarco"), ("iqua", "sparus")):
        wishes.append(guest(declaration, partner, "laptop", MemberKind.LAPTOP))
        wishes.append(guest(declaration, partner, vehicle, MemberKind.ROBOT, vehicle))
    with vpn(declaration, wishes, tmp_path) as made:
        members = made.authority.membership().members
        declared = policy(declaration, made.authority.membership())
        parties = {name: Party(name, member.address) for name, member in members.items()}
        # Both have to reach the other: discovery is a conversation.
        meet = {
            (one, other)
            for one, other in itertools.permutations(parties, 2)
            if declared.allows(parties[one], parties[other], _DDS)
            and declared.allows(parties[other], parties[one], _DDS)
        }
        assert len(meet) == 22, "of 30"
        before = made.counter("p_denied")
        ears = {name: _speak(made, name) for name in parties}
        wait_until(lambda: all(ears[one].words.get(other, 0) >= 3 for one, other in meet))
        assert {(one, other) for one in parties for other in ears[one].words} == meet
        assert made.counter("p_denied") > before, "the others have been tried"


def _speak(made: Vpn, name: str) -> Ear:
    """Everybody's peers are all the others, also those whom he may not reach."""
    file = made.folder / f"{name}.xml"
    file.write_text(_profile(made, name), encoding="utf-8")
    process = made.start(
        name, sys.executable, str(PROGRAM), name, "0", environment={"CYCLONEDDS_URI": f"file://{file}"}
    )
    ear = Ear()
    threading.Thread(target=ear.listen, args=(process,), daemon=True).start()
    return ear


def _profile(made: Vpn, name: str) -> str:
    members = made.authority.membership().members
    dds = made.declaration.pilot.dds
    assert dds is not None
    if name not in made.declaration.hosts:
        peers = "".join(f'<Peer Address="{one.address}"/>' for one in members.values())
        return _OWN.format(own=members[name].address, peers=peers)
    robots = tuple(DdsPeer(name=one.name, address=one.address) for one in members.values() if one.partner is not None)
    pilot = made.declaration.pilot.model_copy(update={"dds": dds.model_copy(update={"peers": robots})})
    declaration = replace(made.declaration, pilot=pilot)
    view = profile_views(declaration, declaration.hosts[name], "pypi")[0]
    return profiles(view)[f"{view.link}/cyclonedds.xml"]
