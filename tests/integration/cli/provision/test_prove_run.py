"""`provision measure satellite` against a router at its address: consent, pins, what is left behind."""

import json
import os
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from hints_said import advised, said
from quay import PROVISION, ROUTER, Quay, quay
from waiting import HANG_S, wait_until

from atlantis_netcfg.cli import main
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.allow_list_test.plan import MARK
from atlantis_netcfg.operations.allow_list_test.prove import ProofPace
from atlantis_netcfg.vpn.enrolment_package.profile import identity_file
from atlantis_netcfg.vpn.identity import Identity, Wrap
from atlantis_netcfg.vpn.rehearsal import rehearsed_identity, vpn_server

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

STRANGER = "10.99.3.3"
"""The target that coastal declares as one to be refused, as the quay spells it."""


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Quay]:
    """The quay with a router beyond whose satellite the stranger does answer, configured."""
    with quay(tmp_path) as opened:
        (twin,) = opened.spec.emulators
        opened.replace("beyond", neighbours=(*twin.router.neighbours, STRANGER))
        opened.adopt()
        opened.configure()
        yield opened


@pytest.mark.smoke
def test_prove_needs_cost_consent_and_leaves_nothing_behind(at: Quay) -> None:
    before = at.export()
    refused = at.provision("measure", "satellite", "site=coastal", "link=satellite", code=4)
    assert "the cost was not accepted, so nothing was sent: over metered link satellite of coastal" in refused.stderr
    told = at.json("measure", "satellite", "site=coastal", "--accept-cost", code=6)
    found = {row["target"]: (row["outcome"], row["verdict"]) for row in told["targets"]}
    assert found[STRANGER] == ("refused here", "PASS")
    assert (told["rehearsed"], told["not_rehearsed"]) == (False, [])
    # No resolver answers in the quay's network: the VPN's name is not taken for good.
    names = [one for one in told["findings"] if one["code"].startswith("allow-list-name-")]
    assert [one["verdict"] in ("INCONCLUSIVE", "WARN") for one in names] == [True]

    opened = at.json("measure", "satellite", "site=coastal", "--open-filter", "--accept-cost", code=6)
    seen = {row["target"]: row["code"] for row in opened["targets"] if row["filter_open"]}
    assert seen == {STRANGER: "only-the-router-enforces"}
    assert 0 < opened["bytes_counted"] < opened["budget_bytes"]
    assert opened["cost"]["payload_bytes"] == opened["bytes_counted"]
    dear = at.provision("measure", "satellite", "site=coastal", "via=4g", code=4)
    assert "the cost was not accepted, so nothing was sent: over metered link 4g" in dear.stderr
    assert at.export().splitlines() == before.splitlines()


ENDPOINT = ("10.99.3.2", 1194)
LAPTOP = "10.64.101.10"
USE = ("links", "use", "site=coastal", "link=satellite", "for=10m", "--yes", "--accept-cost")
PROVE = ("measure", "satellite", "site=coastal", "link=satellite", "--try-all", "--accept-cost")
VPN = "10.99.3.2 udp 1194"


@dataclass
class Beyond:
    """What is at the VPN's address, and what the router is told of it: it does not carry the packets itself."""

    at: Quay
    server: tuple[str, int] | None
    is_carried: bool = True
    """Whether the router has led the questions by itself; otherwise they came by another way."""
    questions: int = 0

    def pump(self, outside: socket.socket, inside: socket.socket) -> None:
        while True:
            datagram, source = outside.recvfrom(2048)
            if not datagram:
                return
            self.questions += 1
            answers = 0
            if self.server is not None:
                inside.sendto(datagram, self.server)
                answers = 1
            if self.is_carried:
                up, down = [1, len(datagram)], [answers, 100 * answers]
                words = {"source": source[0], "source_port": source[1], "up": up, "down": down}
                self.at.do("carry", target=ENDPOINT[0], target_port=ENDPOINT[1], **words)
            if answers:
                outside.sendto(inside.recv(2048), source)


@contextmanager
def beyond(at: Quay, server: tuple[str, int] | None, *, is_carried: bool = True) -> Iterator[Beyond]:
    """Let something stand at the VPN's address, and this computer in the network of the site's technician."""
    for words in (
        f"address add {LAPTOP}/32 dev lo",
        f"address add {ENDPOINT[0]}/32 dev lo",
        f"route replace local {ENDPOINT[0]} dev lo table local src {LAPTOP}",
    ):
        subprocess.run(["ip", *words.split()], check=True)
    made = Beyond(at, server, is_carried=is_carried)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outside,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as inside,
    ):
        outside.bind(ENDPOINT)
        inside.settimeout(HANG_S)
        thread = threading.Thread(target=made.pump, args=(outside, inside))
        thread.start()
        try:
            yield made
        finally:
            inside.sendto(b"", ENDPOINT)
            thread.join()


def hold(at: Quay) -> Identity:
    """Give this computer the identity of the site's router, with the server's shared key."""
    declaration = load(at.inventory, decrypt=lambda _text: "a secret that is long enough")
    identity = rehearsed_identity(declaration, declaration.hosts[ROUTER], Wrap.TLS_CRYPT)
    place = at.state / "vpn" / "hosts" / f"{ROUTER}.identity"
    place.parent.mkdir(mode=0o700, parents=True)
    place.write_text(identity_file(identity).reveal(), "ascii")
    return identity


@pytest.fixture
def prove(at: Quay, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Type `prove` in this process, and count the seconds in which others are silent instead of waiting for them."""

    async def no_wait(_seconds: float) -> None:
        pass

    def typed(*words: str) -> str:
        assert main(list(dict.fromkeys([*words, f"inventory={at.inventory}"]))) == 6, capsys.readouterr()
        return capsys.readouterr().out

    password = at.environment()["ANSIBLE_VAULT_PASSWORD_FILE"]
    monkeypatch.setattr("ansible.constants.DEFAULT_VAULT_PASSWORD_FILE", password)
    monkeypatch.setattr("atlantis_netcfg.operations.allow_list_test.prove.ProofPace", lambda: ProofPace(sleep=no_wait))
    monkeypatch.setenv("ATLANTIS_STATE", str(at.state))
    return typed


def test_link_proved_by_a_vpn_response_can_be_used(at: Quay, prove: Callable[..., str]) -> None:
    """What each command advises is typed: from a refused `use` over `prove` to a link in use, with a real OpenVPN."""
    at.do("wait", seconds=200)
    before = at.export()
    identity = hold(at)
    with vpn_server(identity) as port, beyond(at, ("127.0.0.1", port)) as there:
        refused = at.provision(*USE, code=4).stderr
        hint = (
            "`provision measure satellite site={} link={} --try-all` tests the VPN over it (valid for one hour); or {}"
        )
        (words,) = advised(said(refused, hint))
        assert tuple(words[:-1]) == PROVE[:-1]
        assert f"VPN server ({VPN}) was reached" in prove(*words, "--accept-cost")
        assert there.questions == 1
        assert at.export().splitlines() == before.splitlines()
        assert "satellite carries the traffic of coastal until" in at.provision(*USE, code=0).stdout


def test_response_over_another_link_proves_nothing(at: Quay, prove: Callable[..., str]) -> None:
    at.do("wait", seconds=200)
    identity = hold(at)
    with vpn_server(identity) as port, beyond(at, ("127.0.0.1", port), is_carried=False):
        told = {row["target"]: row for row in json.loads(prove(*PROVE, "--json"))["targets"]}
        assert (told[VPN]["outcome"], told[VPN]["verdict"]) == ("not tested", "INCONCLUSIVE")
    assert "there is no proof that satellite works" in at.provision(*USE, code=4).stderr


def test_killed_prove_leaves_nothing_on_the_router(at: Quay) -> None:
    before = at.export()
    with beyond(at, None) as there:
        hold(at)
        words = [PROVISION, *PROVE, f"inventory={at.inventory}"]
        running = subprocess.Popen(words, env=at.environment(), start_new_session=True, stderr=subprocess.DEVNULL)
        wait_until(lambda: there.questions > 0, lambda: "nobody has asked")
        led = at.do("console", words=["/routing/rule/print", f"?comment={MARK}", f"?src-address={LAPTOP}/32"])
        os.killpg(running.pid, signal.SIGKILL)
        running.wait(HANG_S)
        assert [kind for kind, *_ in led] == ["!re", "!done"]
        wait_until(lambda: at.export().splitlines() == before.splitlines(), at.export)
