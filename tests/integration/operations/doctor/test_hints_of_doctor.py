"""What `provision inventory doctor` advises towards a real router leads on: it is typed as it was printed."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hints_said import advised
from quay import ROUTER, Quay, quay

from atlantis_netcfg.runs import Store

pytestmark = [pytest.mark.slow, pytest.mark.namespace]


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Quay]:
    with quay(tmp_path) as opened:
        (opened.inventory.parent / "vault-password").chmod(0o600)
        yield opened


def items(at: Quay, code: int) -> dict[str, dict[str, Any]]:
    """The router's address is this computer's own there: it is looked at as from far away."""
    done = at.provision("inventory", "doctor", "site=coastal", "via=wifi-ptp", "--json", code=code)
    return {item["name"]: item for item in json.loads(done.stdout)["items"]}


def lines(at: Quay, code: int) -> list[list[str]]:
    """All commands of ours that are advised on the screen, the last one last."""
    printed = at.provision("inventory", "doctor", "site=coastal", "via=wifi-ptp", code=code).stdout
    return [words for line in printed.splitlines() for words in advised(line)]


def test_advised_command_pins_an_unknown_router(at: Quay) -> None:
    Store(at.state).pins.change(ROUTER, None)
    found = items(at, 6)
    assert found["router"]["verdict"] == "WARN"
    assert found["router"]["commands"] == found["known devices"]["commands"]
    assert ROUTER in found["known devices"]["measured"]
    words = next(words for words in lines(at, 6) if words[:2] == ["device", "trust"])
    at.typed(*words, f"device={ROUTER}", answer="yes", code=0)
    after = items(at, 6)
    assert after["router"]["verdict"] == "PASS"
    assert ROUTER not in after["known devices"]["measured"]


def test_plan_is_the_advised_next_step(at: Quay) -> None:
    """The keys of the gateway are nobody's here: without them nothing is red."""
    file = at.inventory / "host_vars" / "coastal-gateway.yml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text[: text.index("  image:")], encoding="utf-8")
    words = lines(at, 0)[-1]
    assert words[:2] == ["plan", "site=coastal"]
    at.provision(*words, code=2)


def test_vault_passwords_are_checked_and_not_shown(at: Quay) -> None:
    done = at.provision("inventory", "doctor", "site=coastal", "via=wifi-ptp", code=6)
    assert "a-real-" not in done.stdout
    assert items(at, 6)["vault"]["measured"].startswith("the password decrypts all ")
