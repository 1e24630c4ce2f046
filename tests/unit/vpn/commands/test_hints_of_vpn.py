"""What the VPN's commands advise is typed as it was printed, where nobody but the authority is needed for it."""

import getpass
import json
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Self

import pytest
from hints_said import advised, said
from vpn_desk import NOBODY, PASSPHRASE, declared, founded

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import vpn_server
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base import session
from atlantis_netcfg.cli.base.playbook import PlayOutcome
from atlantis_netcfg.cli.vpn import _common
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.operations.computers._watch import ComputerResult
from atlantis_netcfg.operations.vpn import router
from atlantis_netcfg.operations.vpn.server import DeployResult, NoPush
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.client import openvpn_client
from atlantis_netcfg.vpn.server import ccd, live_files, openvpn_server

SEALED = f"recipient={NOBODY}"
LAPTOP = ("vpn", "onboard", "partner=iqua", "device=laptop", "kind=laptop", SEALED)
GATEWAY = ("vpn", "onboard", "device=coastal-gateway", SEALED)
ROUTER = ("vpn", "onboard", "device=coastal-router", SEALED)


@dataclass
class Laptop:
    """Somebody at a terminal, with the authority in its usual place; of the server's and the devices' side is noted
    what they would get."""

    folder: Path
    capsys: pytest.CaptureFixture[str]
    monkeypatch: pytest.MonkeyPatch
    plays: list[tuple[list[str], bool]] = field(default_factory=list)
    """Hosts of each play, and whether this computer had an identity for each of them."""
    member: str = ""
    """Who was named last."""

    @property
    def authority(self) -> Authority:
        return Authority.open(self.folder / "vpn")

    def type(self, *words: str, code: int = 0) -> str:
        """Type a command, and give all that it prints."""
        ended = main(words)
        printed = self.capsys.readouterr()
        assert ended == code, f"exit {ended}\n{printed.out}{printed.err}"
        named = [word.partition("=")[2] for word in words if word.startswith(("name=", "device="))]
        self.member = named[0] if named else self.member
        return printed.out + printed.err

    def follow(self, words: Sequence[str], code: int = 0) -> str:
        """Type what was advised; what the control centre hands out for a host is taken on another laptop."""
        if "file=FILE" not in words:
            return self.type(*words, code=code)
        stick = self.folder / "stick"
        stick.mkdir()
        handed = self.type("vpn", "renew", f"name={self.member}", f"to={stick}")
        (passphrase,) = (line.split()[1] for line in handed.splitlines() if line.startswith("  passphrase"))
        (file,) = stick.glob("*.age")
        with self.monkeypatch.context() as patch:
            patch.setattr(getpass, "getpass", lambda _question: passphrase)
            patch.setenv("ATLANTIS_STATE", str(self.folder / "another laptop"))
            return self.type(*(f"file={file}" if word == "file=FILE" else word for word in words), code=code)

    def days_later(self, days: int) -> None:
        """Let time pass, for the record."""

        def later() -> datetime:
            return datetime.now(UTC).replace(microsecond=0) + timedelta(days=days)

        for place in ("_file", "", "_entry"):
            with suppress(AttributeError, ImportError):
                self.monkeypatch.setattr(f"atlantis_netcfg.vpn.ledger{'.' if place else ''}{place}.utc_now", later)
        self.monkeypatch.setattr("atlantis_netcfg.vpn.authority.ledger_session.utc_now", later)


class Play:
    """In place of Ansible: notes who was to be worked on."""

    laptop: Laptop

    def __init__(self, *_: object) -> None:
        pass

    def play(self, names: Sequence[str], request: Any, _notify: object, **_: object) -> PlayOutcome:  # noqa: ANN401
        has = all(request.identity_of(name) is not None for name in names if name != "scc-vpn")
        self.laptop.plays.append((list(names), has))
        return PlayOutcome({name: dict(ComputerResult(name, request.mode).as_dict()) for name in names})


def real() -> Inventory:
    """The shipped pilot as if none of its values were examples."""
    shipped = declared()
    return replace(shipped, pilot=shipped.pilot.model_copy(update={"example_values": False}))


def prepared(tmp_path: Path, base: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Laptop:
    """A laptop with an authority, on which plays go to a stand-in and a person types the passphrase."""
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    shutil.copytree(founded(base) / "vpn", tmp_path / "vpn")
    monkeypatch.setattr(_common, "load_inventory", lambda _arguments: real())
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr(getpass, "getpass", lambda _question: PASSPHRASE)
    made = Laptop(tmp_path, capsys, monkeypatch)
    monkeypatch.setattr(Play, "laptop", made, raising=False)
    monkeypatch.setattr(session, "PlaybookRunner", Play)
    monkeypatch.setattr("atlantis_netcfg.inventory.load", lambda *_, **__: real())
    capsys.readouterr()
    return made


@pytest.fixture
def laptop(
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Laptop:
    monkeypatch.setattr(_common, "server", lambda *_: NoPush())
    founding = Authority.init
    # Sealed as Ansible does it: tests do not wait for age.
    monkeypatch.setattr(
        Authority, "init", lambda folder, word, names, who, _: founding(folder, word, names, who, sealed_by="vault")
    )
    return prepared(tmp_path, tmp_path_factory.getbasetemp(), capsys, monkeypatch)


# --- situations --------------------------------------------------------------------------------------------------


def refused(act: Callable[[], object]) -> str:
    """The words of an error that no command of ours lets through: an earlier check of the command has the same."""
    with pytest.raises((NetcfgError, ModuleError)) as told:
        act()
    return str(getattr(told.value, "hint", ""))


def twice(at: Laptop) -> str:
    at.type(*LAPTOP)
    return at.type(*LAPTOP)


def gone_later(at: Laptop) -> str:
    at.type(*LAPTOP)
    return at.type("vpn", "revoke", "name=iqua-laptop", "--yes", "--no-push", code=5)


def stopped(at: Laptop) -> str:
    def stop(*_: object) -> DeployResult:
        raise KeyboardInterrupt

    with at.monkeypatch.context() as patch:
        patch.setattr(NoPush, "deploy", stop)
        return at.type(*LAPTOP, code=5)


def moved(at: Laptop) -> str:
    """The server's name in the inventory is another one than in its certificate."""
    pilot = real().pilot
    vpn = pilot.vpn.model_copy(update={"endpoint_name": "tunnel.atlantis.internal"})
    changed = replace(real(), pilot=pilot.model_copy(update={"vpn": vpn}))
    at.monkeypatch.setattr(_common, "load_inventory", lambda _arguments: changed)
    return at.type("vpn", "init", code=3)


def served(at: Laptop) -> str:
    moved(at)
    return at.type("vpn", "sync", "--sign")


def without_authority(at: Laptop) -> str:
    shutil.rmtree(at.folder / "vpn")
    return at.type("vpn", "list", code=3)


def without_authority_in_a_run(at: Laptop) -> str:
    shutil.rmtree(at.folder / "vpn")
    return at.type("plan", "site=scc", "device=scc-vpn", code=3)


def without_authority_for_the_server(at: Laptop) -> str:
    membership = at.authority.membership()
    shutil.rmtree(at.folder / "vpn")
    return refused(lambda: openvpn_server(real(), real().hosts["scc-vpn"], membership, at.folder / "vpn"))


def before_the_last_list(at: Laptop) -> None:
    """The list of before somebody was revoked is back, as out of a backup."""
    at.type(*LAPTOP)
    kept = (at.folder / "vpn" / "crl.pem").read_bytes()
    at.type("vpn", "revoke", "name=iqua-laptop", "--yes", "--no-push", code=5)
    (at.folder / "vpn" / "crl.pem").write_bytes(kept)


def an_old_list(at: Laptop) -> str:
    before_the_last_list(at)
    return refused(at.authority.crl)


def an_old_list_is_seen(at: Laptop) -> str:
    before_the_last_list(at)
    return at.type("vpn", "status", "--no-push", code=6)


def a_list_that_ends_soon(at: Laptop) -> str:
    at.days_later(70)
    return at.type("vpn", "status", "--no-push", code=6)


def a_list_that_has_ended(at: Laptop) -> str:
    at.days_later(100)
    return refused(at.authority.crl)


def a_certificate_that_ends_soon(at: Laptop) -> str:
    at.type(*LAPTOP, "days=20")
    return at.type("vpn", "status", "--no-push", code=6)


def with_vpn(at: Laptop, **values: object) -> None:
    """From now on the pilot's VPN has other settings."""
    pilot = real().pilot
    vpn = pilot.vpn.model_copy(update=values)
    changed = replace(real(), pilot=pilot.model_copy(update={"vpn": vpn}))
    at.monkeypatch.setattr(_common, "load_inventory", lambda _arguments: changed)


def a_shared_key_that_ends(at: Laptop) -> str:
    at.type(*LAPTOP, "wrap=tls-crypt")
    with_vpn(at, shared_key_until="2027-03-31")
    return at.type("vpn", "status", "--no-push")


def a_key_without_a_cookie(at: Laptop) -> str:
    at.type(*ROUTER)
    with_vpn(at, force_cookie=True)
    return at.type("vpn", "status", "--no-push")


def another_wish(at: Laptop) -> str:
    at.type(*LAPTOP)
    return at.type(*LAPTOP, "link=satellite", code=3)


def no_such_member(at: Laptop) -> str:
    at.type(*LAPTOP)
    return at.type("vpn", "show", "name=qqq", code=3)


def of_the_signer(at: Laptop, act: Callable[[Any], object]) -> str:
    at.type(*LAPTOP)
    with at.authority.unlock(lambda: Secret(PASSPHRASE), "test") as signer:
        return refused(lambda: act(signer))


def an_identity_that_has_ended(at: Laptop) -> str:
    at.type(*ROUTER, "days=20")

    class Days30(datetime):
        @classmethod
        def now(cls, tz: Any = None) -> Self:  # noqa: ANN401 - as datetime has it
            return super().now(tz) + timedelta(days=30)

    at.monkeypatch.setattr(router, "datetime", Days30)
    return at.type("vpn", "install", "device=coastal-router", code=3)


def a_gateway_without_identity(_at: Laptop) -> str:
    made = openvpn_client(real(), real().hosts["coastal-gateway"], None).as_dict()
    return json.dumps(made, ensure_ascii=False)


def a_strange_name(at: Laptop) -> str:
    at.type(*LAPTOP)
    member = at.authority.membership().members["iqua-laptop"]
    (one,) = member.certificates
    return refused(lambda: ccd(member, replace(one, common_name="../x"), real()))


def a_list_of_another(at: Laptop) -> str:
    files = live_files(real(), at.authority.membership(), at.authority.crl(), ca=(at.folder / "vpn/ca.crt").read_text())
    return "\n".join(file.hint for file in files)


def of_an_older_copy(at: Laptop) -> str:
    at.type(*LAPTOP)
    new, old = (vpn_server.Crl(is_signed=True, number=number, begins=0, ends=10) for number in (3, 4))
    return refused(lambda: vpn_server.accept(new, old, 5.0))


def by_the_servers_clock(at: Laptop) -> str:
    new = vpn_server.Crl(is_signed=True, number=9, begins=0, ends=10)
    assert at.authority.membership().crl_number >= 1
    return refused(lambda: vpn_server.accept(new, None, 20.0))


# --- what is typed -----------------------------------------------------------------------------------------------

Situation = tuple["Callable[[Laptop], str]", str, int, str]
"""What brings it about, the hint, how the advised command ends (of several, each), and what it then says."""
LIST = ("`provision vpn list` lists them all", 0, "iqua-laptop")
SITUATIONS: dict[str, Situation] = {
    "a member that is there": (
        twice,
        "created earlier; if its passphrase is lost: provision vpn renew name={}",
        0,
        "iqua-laptop.2",
    ),
    "left for later": (
        lambda at: at.type(*LAPTOP, "--no-push"),
        "the server was not contacted (`--no-push`): `provision vpn sync` updates it",
        0,
        "",
    ),
    "revoked, for later": (gone_later, "`provision vpn sync` ends their sessions: {}", 0, ""),
    "stopped by hand": (
        stopped,
        "recorded changes remain: run the same command again, or check with `provision vpn status`",
        0,
        "iqua-laptop",
    ),
    "another server": (
        moved,
        (
            "if the inventory is right, run `provision vpn sync --sign` to issue a new server certificate; for "
            "another authority, use another folder: `authority=FOLDER`"
        ),
        0,
        "the server has a new certificate",
    ),
    "a new certificate of the server": (
        served,
        "the server has a new certificate: `provision site={}` installs it",
        0,
        "matches the inventory",
    ),
    "nobody ends soon": (
        lambda at: twice(at) and at.type("vpn", "renew", "all=30d", code=7),
        "`provision vpn list` shows the expiry dates",
        0,
        "until",
    ),
    "no authority": (
        without_authority,
        "`provision vpn init` creates one; `authority=DIR` names it",
        0,
        "created: VPN",
    ),
    "no authority for a run": (
        without_authority_in_a_run,
        "create one: `provision vpn init`; {}",
        0,
        "created: VPN",
    ),
    "no authority for the server": (
        without_authority_for_the_server,
        "create one: `provision vpn init`; if a colleague has it, do not copy it: let them run this",
        0,
        "created: VPN",
    ),
    "nobody is in": (
        lambda at: at.type("vpn", "list", code=7),
        "to add one, see `provision vpn onboard --help`",
        0,
        "provision vpn onboard",
    ),
    "no such member": (no_such_member, *LIST),
    "no such member, for the record": (
        lambda at: of_the_signer(at, lambda signer: signer.revoke(["qqq"], "a test")),
        "`provision vpn list` shows them all",
        0,
        "iqua-laptop",
    ),
    "nobody named": (lambda at: of_the_signer(at, lambda signer: signer.revoke([], "a test")), *LIST),
    "another wish": (
        another_wish,
        "`provision vpn renew name={}` changes link, wrap, key and system; otherwise use another name",
        0,
        "iqua-laptop.2",
    ),
    "an old list": (an_old_list, "`provision vpn sync --sign` signs a new one", 0, ""),
    "an old list is seen": (
        an_old_list_is_seen,
        "{} lacks serial {}, which is revoked: provision vpn sync --sign",
        0,
        "",
    ),
    "a list that ends soon": (
        a_list_that_ends_soon,
        "{} expires on {}; then nobody can connect: provision vpn sync --sign",
        0,
        "",
    ),
    "a list that has ended": (
        a_list_that_has_ended,
        "check this computer's clock, then sign a new one: provision vpn sync --sign",
        0,
        "",
    ),
    "a certificate that ends soon": (
        a_certificate_that_ends_soon,
        "{} {} on {}: provision vpn renew name={}",
        0,
        "iqua-laptop.2",
    ),
    "a shared key that ends": (
        a_shared_key_that_ends,
        "if they have OpenVPN 2.5 or later: `provision vpn renew name={} wrap=tls-crypt-v2`",
        0,
        "iqua-laptop.2",
    ),
    "a key without a cookie": (
        a_key_without_a_cookie,
        "`provision vpn renew name={}` creates a key that works with any OpenVPN",
        0,
        "coastal-router.2",
    ),
    "an identity for a gateway": (
        lambda at: at.type(*GATEWAY),
        "provision site={} device={}",
        0,
        "matches the inventory",
    ),
    "an identity that has ended": (
        an_identity_that_has_ended,
        (
            "run `provision vpn renew name={}` on the computer of the authority, then install the new enrolment "
            "package here"
        ),
        0,
        "coastal-router.2",
    ),
    "nothing to install on a gateway": (
        lambda at: at.type("vpn", "install", "device=coastal-gateway", code=7),
        "gateways get theirs from `provision site={}`",
        0,
        "matches the inventory",
    ),
    "a gateway without identity": (
        a_gateway_without_identity,
        (
            "{} has no identity of the VPN, neither there nor on this computer: its tunnel does not come up. Type "
            "`provision vpn onboard device={}` where the authority is, or `provision vpn accept file=FILE` with "
            "what the "
            "control centre has handed out, then the same again"
        ),
        0,
        "coastal-gateway",
    ),
    "a strange name": (a_strange_name, "the ledger is not as this toolkit writes it: `provision vpn audit`", 0, ""),
    "a list of another authority": (
        a_list_of_another,
        (
            "it is not signed by this authority, or older than the one on the server: with it a revoked member could "
            "connect. See `provision vpn status`, and run the same command again"
        ),
        0,
        "the record matches its signature",
    ),
    "a list that cannot be read": (
        lambda _: refused(lambda: vpn_server.accept(None, None, 0.0)),
        "`provision vpn status` shows what is wrong with the authority's own list",
        0,
        "the record matches its signature",
    ),
    "what an audit does not check": (
        lambda at: at.type(*LAPTOP) and at.type("vpn", "audit"),
        "this command does not check whether this is the newest copy: `provision vpn status` asks the server",
        0,
        "the record matches its signature",
    ),
    "a list of an older copy": (
        of_an_older_copy,
        (
            "this is not the newest copy of the authority: find the one that made list {}; `provision vpn status` "
            "shows what the server knows beyond this copy, and what to do if the newest copy is lost"
        ),
        0,
        "iqua-laptop",
    ),
    "a list that has ended by the server's clock": (
        by_the_servers_clock,
        "check `date` on the server; if it is right, `provision vpn sync --sign` signs a new list",
        0,
        "",
    ),
}


@pytest.mark.smoke("a member that is there", "left for later", "a list that has ended", "an identity for a gateway")
@pytest.mark.parametrize("name", SITUATIONS)
def test_suggested_commands_work(name: str, laptop: Laptop) -> None:
    brings, hint, code, says = SITUATIONS[name]
    commands = advised(said(brings(laptop), hint))
    assert commands
    for words in commands:
        number = laptop.authority.membership().crl_number if (laptop.folder / "vpn").exists() else 0
        printed = laptop.follow(words, code)
        assert says in printed
        if "--sign" in words:
            assert laptop.authority.membership().crl_number > number
            laptop.authority.crl()
        if words[0].startswith("site="):
            assert laptop.plays
        if words[0].startswith("site=") and words[-1] == "device=coastal-gateway":
            assert laptop.plays == [(["coastal-gateway"], True)]
