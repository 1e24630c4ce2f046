"""A copy of the authority from before a revocation is put back, and everything is typed with it, in every order.

The server is OpenVPN itself; a revoked device tries to come in with the identity that it was handed.
"""

import itertools
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import live_stand
import pytest
from _pytest.mark import ParameterSet
from cryptography import x509
from live_stand import NAME, Client, Record, Server, declaration
from local_link import LocalLink
from vpn_desk import NOBODY, PASSPHRASE, Desk, seated

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.operations.computers.remote_session import ServerRefusal
from atlantis_netcfg.operations.vpn import live
from atlantis_netcfg.operations.vpn import server as connected
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.server import CCD, FOLDER

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

OLDER = "this record is older than the server"
STEPS = ("restore", "revoke", "renew", "push")


def _sampled() -> Iterator[ParameterSet]:
    """All orders, with the server asked and not asked; in CI every other order, one way after the other."""
    for number, order in enumerate(itertools.permutations(STEPS)):
        for way, more in enumerate(((), ("--no-push",))):
            marks = [] if number % 2 == 0 and number // 2 % 2 == way else [pytest.mark.campaign]
            yield pytest.param(order, more, id="-".join((*order, "not-asked" if more else "asked")), marks=marks)


@dataclass
class Pilot:
    """A server with three members, of which one is revoked, and a copy of the authority from before that."""

    desk: Desk
    server: Server
    lost: str
    other: str
    third: str
    clients: dict[str, Client] = field(default_factory=dict)
    revoked: set[str] = field(default_factory=set)
    """Whose revocation the server has confirmed."""
    restored: bool = False

    @property
    def backup(self) -> Path:
        return self.desk.folder / "backup"

    def type(self, *words: str) -> tuple[int, str]:
        signs = words[0] != "sync" or "--sign" in words
        code, out, err = self.desk.type(*words, passphrase=PASSPHRASE if signs else None)
        return code, out + err

    def keep(self) -> None:
        shutil.copytree(self.desk.authority, self.backup)

    def restore(self, *_: str) -> None:
        shutil.rmtree(self.desk.authority)
        shutil.copytree(self.backup, self.desk.authority)
        self.restored = True

    def revoke(self, *more: str) -> None:
        code, said = self.type("revoke", f"name={self.other}", "--yes", *more)
        if more:
            assert (code, "the server does not have it" in said) == (5, True), said
        elif self.asked(code, said):
            assert "verified: no session" in said
            self.revoked.add(self.other)

    def renew(self, *more: str) -> None:
        code, said = self.type("renew", f"name={self.third}", f"recipient={NOBODY}", *more)
        if more:
            assert (code, "the server was not contacted (`--no-push`)" in said) == (0, True), said
        else:
            self.asked(code, said)

    def push(self, *_: str) -> None:
        code, said = self.type("sync")
        if self.asked(code, said) and self.other not in self.admitted():
            self.revoked.add(self.other)

    def asked(self, code: int, said: str) -> bool:
        """Whether the server was brought to the record: by the newest copy it is, an older one is refused, and told."""
        assert (code, OLDER in said) == ((4, True) if self.restored else (0, False)), said
        return not self.restored

    def admitted(self) -> set[str]:
        return {path.name for path in self.server.at(CCD).iterdir() if not path.name.startswith(".")}

    def listed(self) -> set[int]:
        listed = x509.load_pem_x509_crl(self.server.at(f"{FOLDER}/crl.pem").read_bytes())
        return {one.serial_number for one in listed}

    def nobody_is_readmitted(self) -> None:
        serials = {self.server.record.identities[name].certificate.serial for name in self.revoked}
        assert serials <= self.listed()
        assert self.revoked.isdisjoint(self.admitted())
        assert "FAIL" not in self.server.drift()

    def nobody_comes_back(self) -> None:
        for name in sorted(self.revoked):
            client = self.clients[name]
            client.stop()
            before = self.server.log().count("certificate revoked")
            client.start(wait=False)
            self.server.said("certificate revoked", before + 1)
            assert not client.up, f"{name} came back"
            client.stop()


@pytest.fixture
def pilot(
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Pilot]:
    desk = seated(tmp_path_factory.getbasetemp(), tmp_path, capsys, monkeypatch)
    monkeypatch.setattr(live_stand, "_PASSPHRASE", Secret(PASSPHRASE))
    with ExitStack() as stack:
        record = Record(Authority.open(desk.authority))
        lost, other, third = record.onboard(3)
        server = Server(stack, record)
        server.push()
        server.start()
        monkeypatch.setattr(connected, "over_ssh", lambda *_: lambda: LocalLink(NAME, server.enter))
        made = Pilot(desk, server, lost, other, third)
        for name in (made.lost, made.other):
            made.clients[name] = server.client(name)
            made.clients[name].start()
        made.keep()
        code, said = made.type("revoke", f"name={made.lost}", "--yes")
        assert (code, "verified: no session" in said) == (0, True), said
        made.revoked.add(made.lost)
        yield made
        assert server.lives


@pytest.mark.parametrize(("order", "more"), list(_sampled()))
def test_restored_copy_readmits_nobody_in_any_order_of_commands(
    order: tuple[str, ...], more: tuple[str, ...], pilot: Pilot
) -> None:
    for step in order:
        getattr(pilot, step)(*more)
        pilot.nobody_is_readmitted()
    pilot.nobody_comes_back()


def test_server_refuses_what_an_older_copy_signs(pilot: Pilot) -> None:
    """Of one who does not look before: with the same number and another list, and with one that lacks somebody."""
    server, record = pilot.server, pilot.server.record
    pilot.restore()
    refusals = []
    for names in ((pilot.other,), (pilot.third,)):
        evidence = server.revoke(*record.revoke(*names))
        assert (evidence.is_confirmed, evidence.out) == (False, False)
        assert "list installed" not in [step for step, _ in evidence.steps]
        refusals.append(" ".join(evidence.notes))
        with pytest.raises(ServerRefusal, match="a revoked member could connect again"):
            live.push(declaration(), record.authority, server.link)
        pilot.nobody_is_readmitted()
        assert not set(names) & pilot.admitted(), "who is revoked by an older copy is out all the same"
    assert "like the server's, but differs from it" in refusals[0]
    assert "lacks 1 of the certificates that are revoked on the server" in refusals[1]
    pilot.nobody_comes_back()


def test_status_reports_that_the_record_is_older_and_changes_nothing(pilot: Pilot) -> None:
    pilot.restore()
    before = pilot.listed(), pilot.admitted()
    code, out, _ = pilot.desk.type("status")
    assert (code, OLDER in out, f"it revokes {pilot.lost}" in out) == (6, True, True), out
    assert "`provision vpn sync` updates" not in out
    assert (pilot.listed(), pilot.admitted()) == before


def test_permanently_lost_copy_is_rebuilt_from_the_server(pilot: Pilot) -> None:
    """Also of those whom only the lost copy has known."""
    record = pilot.server.record
    (unknown,) = record.onboard()
    pilot.server.push()
    pilot.clients[unknown] = pilot.server.client(unknown)
    code, said = pilot.type("revoke", f"name={unknown}", "--yes")
    assert code == 0, said
    pilot.revoked.add(unknown)
    pilot.restore()
    assert OLDER in pilot.type("sync", "--sign")[1]
    code, said = pilot.type("sync", "--sign", "--take-list")
    assert (code, f"imported from the server's list: {pilot.lost}" in said) == (0, True), said
    pilot.restored = False
    pilot.nobody_is_readmitted()
    assert pilot.desk.told("status")["exit"] == 0
    assert not Authority.open(pilot.desk.authority).membership().members[pilot.lost].good
    (pilot.desk.authority / "crl.pem").unlink()
    pilot.revoke()
    pilot.renew()
    pilot.push()
    pilot.nobody_is_readmitted()
    pilot.nobody_comes_back()
