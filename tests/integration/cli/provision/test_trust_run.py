"""A device that nobody has agreed to is told nothing, whatever is typed; it is agreed to on a terminal, or declared."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hints_said import advised, said
from impostor import Impostor, impostor
from npk_files import write
from quay import ADDRESS, ROUTER, Quay, quay

from atlantis_netcfg.core.errors import TRUST
from atlantis_netcfg.runs import Store

pytestmark = [pytest.mark.slow, pytest.mark.namespace]

UNKNOWN = "its certificate is unknown here, so no password was sent"
OPENING: dict[str, tuple[str, ...]] = {
    "plan": ("plan", "site=coastal"),
    "change": ("site=coastal", "--yes"),
    "drift": ("report", "drift", "site=coastal"),
    "backup": ("device", "backup", "site=coastal"),
    "resume": ("recover", "resume", "site=coastal"),
    "links": ("links", "site=coastal", "--accept-cost"),
    "prove": ("measure", "satellite", "site=coastal", "--accept-cost"),
    "upgrade": ("device", "upgrade", "site=coastal", f"device={ROUTER}", "packages=FILE", "--plan"),
    "check": ("check", "site=coastal", "endpoint=site", "--accept-cost"),
}
"""Every command that opens a session to a router, with what it needs to come so far."""


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Quay]:
    with quay(tmp_path) as opened:
        Store(opened.state).pins.change(ROUTER, None)
        yield opened


@pytest.fixture
def nobody(at: Quay, tmp_path: Path) -> Iterator[Impostor]:
    """Somebody else answers at the router's address."""
    with impostor(tmp_path) as who:
        at.door.port = who.port
        yield who


def trusted(at: Quay) -> str | None:
    return Store(at.state).pins.get(ROUTER)


@pytest.mark.parametrize("known", [False, True], ids=["unknown", "another"])
@pytest.mark.parametrize("name", OPENING)
def test_no_password_is_sent_to_an_unknown_device(
    at: Quay, nobody: Impostor, tmp_path: Path, name: str, *, known: bool
) -> None:
    """Also with `--json`, and where the device that answers is another one than the one that is known."""
    if known:
        at.adopt()
    file = write(tmp_path, "routeros", "7.21.5", "arm64")
    words = tuple(word.replace("FILE", str(file)) for word in OPENING[name])
    for more in ((), ("--json",)):
        done = at.provision(*words, *more, code=6 if name in {"links", "check"} else 4)
        told = done.stdout + done.stderr
        assert "the certificate is not the one of this device" in told if known else UNKNOWN in told
        assert "provision device trust site=coastal" in told or name == "check"
    assert nobody.handshakes >= 2, "it was contacted, and told nothing all the same"
    assert bytes(nobody.heard) == b""
    assert trusted(at) == (at.twins.ready[ROUTER]["pin"] if known else None)


def test_plain_ansible_refuses_an_unpinned_router(at: Quay, nobody: Impostor) -> None:
    done = at.playbook()
    assert done.returncode != 0
    assert UNKNOWN in " ".join(done.stdout.split())
    assert (nobody.handshakes >= 1, bytes(nobody.heard), trusted(at)) == (True, b"", None)


@pytest.mark.smoke
def test_certificate_is_shown_and_pinned_after_consent(at: Quay) -> None:
    shown = at.twins.ready[ROUTER]["pin"]
    refused = at.typed("device", "trust", "site=coastal", f"device={ROUTER}", answer="no", code=4)
    assert f"its certificate is {shown}" in refused
    assert (trusted(at), "nothing was changed" in refused) == (None, True)
    said = at.typed("device", "trust", "site=coastal", f"device={ROUTER}", answer="yes", code=0)
    assert "/certificate print detail" in said
    assert f"fingerprint: {shown}" in said
    assert trusted(at) == shown
    assert "as accepted before" in at.typed("device", "trust", "site=coastal", f"device={ROUTER}", answer="", code=0)
    at.provision("plan", "site=coastal", code=2)


def test_advised_command_pins_the_router(at: Quay) -> None:
    """The command is typed as it was printed; then the run goes through."""
    refused = at.provision("plan", "site=coastal", code=4)
    (words, *_) = advised(said(refused.stdout + refused.stderr, TRUST))
    at.typed(*words, f"device={ROUTER}", answer="yes", code=0)
    at.provision("plan", "site=coastal", code=2)


def test_trust_without_a_terminal_is_refused(at: Quay, nobody: Impostor) -> None:
    done = at.provision("device", "trust", "site=coastal", f"device={ROUTER}", code=3)
    assert "no terminal to confirm an identity: nothing was trusted" in done.stderr
    assert (nobody.handshakes, trusted(at)) == (0, None)


def test_changed_certificate_is_shown_beside_the_pinned_one(at: Quay, nobody: Impostor) -> None:
    at.adopt()
    before = at.twins.ready[ROUTER]["pin"]
    said = at.typed("device", "trust", "site=coastal", f"device={ROUTER}", answer="no", code=4)
    assert f"its certificate is {nobody.fingerprint}; accepted before: {before}" in said
    assert (trusted(at), bytes(nobody.heard)) == (before, b"")


def declare(at: Quay, fingerprint: str) -> None:
    """Write it under the router's `access`."""
    file = at.inventory / "host_vars" / f"{ROUTER}.yml"
    text, found = re.subn(
        rf"address: {ADDRESS[0]}\b", rf"\g<0>, fingerprint: {fingerprint}", file.read_text(encoding="utf-8"), count=1
    )
    assert found == 1
    file.write_text(text, encoding="utf-8")


def test_inventory_fingerprint_is_accepted_without_a_local_pin(at: Quay) -> None:
    """For every door, with a state folder that has never seen the device."""
    shown = at.twins.ready[ROUTER]["pin"]
    declare(at, f'"{":".join(re.findall("..", shown)).upper()}"')
    at.provision("plan", "site=coastal", code=2)
    assert at.playbook("--check").returncode == 0
    assert trusted(at) is None
    assert "as in the inventory" in at.typed("device", "trust", "site=coastal", f"device={ROUTER}", answer="", code=0)


def test_inventory_fingerprint_overrides_the_local_pin(at: Quay, nobody: Impostor) -> None:
    Store(at.state).pins.change(ROUTER, nobody.fingerprint)
    declare(at, at.twins.ready[ROUTER]["pin"])
    told = json.loads(at.provision("plan", "site=coastal", "--json", code=4).stdout)
    assert "the certificate is not the one of this device" in told["devices"][ROUTER]["message"]
    said = at.typed("device", "trust", "site=coastal", f"device={ROUTER}", answer="yes", code=4)
    assert "but the inventory has" in said
    assert bytes(nobody.heard) == b""
