"""What is advised of a router that lacks something is typed as it was printed, with the router as it is there."""

import builtins
import getpass
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hints_said import advised, said
from npk_files import write
from quay import ROUTER, Door, Quay, forwarded, quay
from vpn_desk import PASSPHRASE

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode, NetcfgError
from atlantis_netcfg.emulator.routeros import DeviceMode, DeviceModeName
from atlantis_netcfg.operations import upgrade
from atlantis_netcfg.operations.upgrade import WaitingUpgrade
from atlantis_netcfg.runs import Store
from atlantis_netcfg.vpn.authority.authority import Authority

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
HERE = (f"device={ROUTER}", "--yes")


@dataclass
class Technician:
    """Somebody at a terminal who agrees to everything."""

    at: Quay
    capsys: pytest.CaptureFixture[str]

    def type(self, *words: str, code: int = 0) -> str:
        """Type a command; nothing but the router stands at this quay."""
        more = HERE if words[0] == "site=coastal" else ()
        ended = main([*dict.fromkeys([*words, *more, f"inventory={self.at.inventory}"])])
        printed = self.capsys.readouterr()
        assert ended == code, f"exit {ended}\n{printed.out}{printed.err}"
        return printed.out + printed.err

    def follow(self, printed: str, hint: str, code: int = 0) -> str:
        """Type the first command of a hint that was printed."""
        words, *_ = advised(said(printed, hint))
        return self.type(*words, code=code)

    def rows(self, menu: str) -> list[dict[str, str]]:
        answer = self.at.do("console", words=[f"{menu}/print"])
        return [dict(word[1:].partition("=")[::2] for word in words) for kind, *words in answer if kind == "!re"]


@pytest.fixture
def technician(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Technician]:
    with quay(tmp_path) as at:
        for name, value in at.environment().items():
            monkeypatch.setenv(name, value)
        monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
        vault = (tmp_path / "vault-password").read_text(encoding="utf-8")
        monkeypatch.setattr(getpass, "getpass", lambda question: vault if "vault" in question else PASSPHRASE)
        monkeypatch.setattr(builtins, "input", lambda _question: "yes")
        founding = Authority.init
        # Sealed as Ansible does it: tests do not wait for age.
        monkeypatch.setattr(
            Authority, "init", lambda folder, word, names, who, _: founding(folder, word, names, who, sealed_by="vault")
        )
        yield Technician(at, capsys)


def test_router_without_certificate_gets_one_by_following_the_hints(technician: Technician) -> None:
    """From the refused run to the run that is as declared, each step as the one before has advised."""
    for row in technician.rows("/certificate"):
        if row["name"] == "atlantis-vpn":
            technician.at.do("console", words=["/certificate/remove", f"=.id={row['.id']}"])
    refused = technician.type("site=coastal", code=4)
    lacking = technician.follow(refused, "type `provision vpn install device={}` first", code=3)
    onboard = (
        "run `provision vpn onboard device={}` on the computer of the authority; elsewhere `provision vpn accept "
        "file=FILE` with the enrolment package"
    )
    nobody = technician.follow(lacking, onboard, code=3)
    technician.follow(nobody, "`provision vpn init` creates one; `authority=DIR` names it")
    handed = technician.follow(lacking, onboard, code=5)  # the server is not reached from here, and waits
    technician.follow(handed, "provision vpn install device={}")
    technician.type("site=coastal")
    assert "no changes needed" in technician.type("site=coastal")
    technician.type("vpn", "renew", f"name={ROUTER}", "key=ec", code=5)
    installed = technician.follow(handed, "provision vpn install device={}")
    tried = "its elliptic-curve key is untested with RouterOS: `provision vpn renew name={} key=rsa`"
    technician.follow(installed, tried, code=5)
    renewed = technician.follow(handed, "provision vpn install device={}")
    assert "elliptic" not in renewed
    lost = (
        "rows that named the former interface (lists, routes) no longer do: type `provision site={site}` when "
        "this is done"
    )
    technician.follow(renewed, lost)
    assert "no changes needed" in technician.type("site=coastal")


class NothingBehindIt(NetcfgError):
    """No console is plugged in here."""

    exit = ExitCode.NOTHING


def test_unprotected_router_leads_to_adoption(technician: Technician, monkeypatch: pytest.MonkeyPatch) -> None:
    met: list[str] = []

    def adoption(_arguments: object, _declaration: object, host: Any, *_: object) -> None:  # noqa: ANN401 - a host
        met.append(host.name)
        raise NothingBehindIt("it would be looked for")

    monkeypatch.setattr("atlantis_netcfg.cli.adopt._adoption", adoption)
    technician.at.replace("old", version="7.17.1", device_mode=DeviceMode(mode=DeviceModeName.HOME))
    technician.at.adopt()
    refused = technician.type("site=coastal", code=4)
    hint = (
        "pin its SSH host key with `provision device adopt site=… device=…`, upgrade it to RouterOS 7.18, or add "
        "--without-protection with somebody next to the device"
    )
    technician.follow(refused, hint, code=7)
    assert met == [ROUTER]
    assert "--without-protection" in refused
    technician.type("site=coastal", "--without-protection")


def old(technician: Technician, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a router of an older version in the place of the one that is there; it is back from a boot within seconds."""
    at = technician.at
    monkeypatch.setattr(upgrade, "WaitingUpgrade", lambda: WaitingUpgrade(poll_s=0.2, connect_s=1.0))
    at.replace("old", version="7.16")
    at.adopt()
    at.do("knobs", boot_s=0.3)
    Store(at.state).pins.change_host_key(ROUTER, at.twins.ready["old"]["host_key"])
    at.stack.enter_context(forwarded(Door(at.twins.ready["old"]["ssh"]), 22))


def packed(words: Sequence[str], folder: Path) -> list[str]:
    """What was advised, with the package of RouterOS in the place of the file, and that of the radio beside it."""
    system, radio = (write(folder, name, "7.21.5", "arm64") for name in ("routeros", "wifi-qcom"))
    return [*(word.replace("FILE.npk", str(system)) for word in words), f"packages={radio}"]


def test_router_that_lacks_a_feature_is_upgraded_and_gets_it(
    technician: Technician, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = technician.at
    at.configure()
    words = ["=name=siem", "=target=remote", "=remote=10.99.1.9", "=remote-log-format=cef"]
    at.do("console", words=["/system/logging/action/add", *words])
    at.configure()
    old(technician, monkeypatch)
    restore = ("device", "restore", f"device={ROUTER}", "run=latest", "--yes")
    refused = technician.type(*restore, code=4)
    hint = (
        "install RouterOS {} or later on it: `provision device upgrade site=… device=… packages=FILE.npk`, where "
        "FILE.npk is MikroTik's package for {}"
    )
    words, *_ = advised(said(refused, hint))
    assert "install RouterOS 7.18 or later on it" in refused
    technician.type(*packed(words, tmp_path))
    technician.type(*restore)
    assert "siem" in {row["name"] for row in technician.rows("/system/logging/action")}


def test_a_router_that_is_too_old_is_upgraded_and_joins(
    technician: Technician, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old(technician, monkeypatch)
    technician.type("vpn", "init")
    handed = technician.type("vpn", "onboard", f"device={ROUTER}", code=5)
    (install,) = (words for words in advised(handed) if words[:2] == ["vpn", "install"])
    refused = technician.type(*install, code=4)
    (words,) = advised(said(refused, "`provision device upgrade site={} device={} packages=FILE.npk`"))
    upgraded = technician.type(*packed(words, tmp_path))
    assert "RouterOS 7.16 -> 7.21.5, verified" in upgraded
    assert "is imported with certificate atlantis-vpn (read back)" in technician.type(*install)
