"""Every command that has `--json`, over every kind of link, each metered one with a price: it prints one object."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import preforked
import pytest
import yaml
from quay import CHECKOUT

from atlantis_netcfg.cli.base.commands import COMMANDS, load
from atlantis_netcfg.core.errors import ExitCode

pytestmark = pytest.mark.slow

ROUTER = "site=coastal device=coastal-router"
LINKS = ("wifi-ptp", "4g", "satellite")
LINES: dict[str, str] = {
    "run": ROUTER,
    "links": f"links {ROUTER}",
    "check": "check site=coastal endpoint=site --anew",
    "report drift": f"report drift {ROUTER}",
    "device adopt": "device adopt site=coastal device=coastal-router --plan",
    "device backup": f"device backup {ROUTER}",
    "report as-built": "report as-built site=coastal",
    "links use": "links use site=coastal link=LINK for=10m --unproved --accept-cost --plan",
    "measure satellite": "measure satellite site=coastal",
    "measure link": "measure link site=coastal link=LINK profile=telemetry --max-minutes 0.1 --max-eur 5",
    "measure coverage": "measure coverage site=coastal link=4g",
    "robot retrieve": "robot retrieve site=coastal link=LINK",
    "device verify": "device verify device=coastal-router",
    "recover resume": "recover resume site=coastal",
    "recover rollback": f"recover rollback {ROUTER} run=latest --yes",
    "device restore": "device restore device=coastal-router run=latest --plan",
    "device upgrade": "device upgrade site=coastal device=coastal-router packages=MISSING.npk --plan",
    "vpn install": "vpn install device=coastal-router --plan",
    "report runs": "report runs --rehearse",
    "plan apply": "apply MISSING.plan",
    "inventory init": "init FOLDER",
    "inventory validate": "validate",
    "inventory doctor": "doctor",
    "measure show": "measure show site=coastal link=LINK --rehearse",
    "measure compare": "measure compare site=coastal run=latest,latest --rehearse",
    "measure history": "measure history site=coastal link=LINK --rehearse",
    "robot dds": "robot dds site=coastal device=coastal-gateway",
    "measure fit": "measure fit site=coastal vehicle=sparus",
    "robot validate": "robot validate vehicle=sparus",
    "robot discover": "robot discover site=coastal for=5s",
    "report checklists": "report checklists site=coastal --rehearse",
    "report show": "report show site=coastal --rehearse",
    "report verify": "report verify site=coastal",
    "gateway image": "gateway image site=coastal device=coastal-gateway from=MISSING.img",
    "gateway bundle": "gateway bundle site=coastal check=MISSING.bundle",
    "vpn init": "vpn init sealed=vault",
    "vpn onboard": "vpn onboard partner=iqua device=auv2 kind=robot",
    "vpn list": "vpn list",
    "vpn show": "vpn show name=iqua-auv1",
    "vpn renew": "vpn renew name=iqua-auv1",
    "vpn revoke": "vpn revoke name=iqua-auv1 reason=stolen --yes",
    "vpn sync": "vpn sync",
    "vpn status": "vpn status",
    "vpn audit": "vpn audit",
    "vpn accept": "vpn accept file=MISSING.csr",
    "robot invite": "robot invite name=visitor partner=iqua kind=auv until=2026-12-24 site=coastal cells=ethernet",
    "robot dismiss": "robot dismiss name=visitor",
    "help version": "help version",
    "plan": f"plan {ROUTER}",
    "recover": "recover",
}
"""Each rehearsed where it can be. LINK stands for each link of the site."""
ENDS = {
    **dict.fromkeys(("plan", "links use", "device adopt", "vpn install"), ExitCode.CHANGES),
    **dict.fromkeys(
        (
            "links",
            "device backup",
            "measure coverage",
            "recover rollback",
            "device restore",
            "report show",
            "robot dds",
        ),
        ExitCode.DONE,
    ),
    **dict.fromkeys(("report drift", "measure satellite", "measure link", "measure show"), ExitCode.CHECKS_FAILED),
}
"""Of those whose result is known: a line that was refused would prove nothing."""


def test_every_json_command_has_a_test_line() -> None:
    assert LINES.keys() == {name for name in COMMANDS if load(name, COMMANDS).command.flag("json") is not None}


@pytest.fixture
def priced(tmp_path: Path) -> Path:
    """The shipped inventory with a tariff for every metered link."""
    root = tmp_path / "inventory"
    shutil.copytree(CHECKOUT / "inventory", root)
    path = root / "group_vars" / "coastal.yml"
    text = path.read_text(encoding="utf-8")
    rate = "      rate: {rtt_ms: 60, up_kbps: 20000, down_kbps: 20000} # EXAMPLE\n"
    assert text.count(rate) == 1
    path.write_text(text.replace(rate, f"{rate}      billing: {{price_per_mb: 0.35}} # EXAMPLE\n"), encoding="utf-8")
    links = yaml.safe_load(path.read_text(encoding="utf-8"))["site"]["bearers"]
    assert {link["name"] for link in links if link["metered"]} == {link["name"] for link in links if "billing" in link}
    return root


def test_each_command_prints_one_json_object(tmp_path: Path, priced: Path) -> None:
    environment = {**os.environ, "ATLANTIS_STATE": str(tmp_path / "state"), "HOME": str(tmp_path)}
    failures = []
    for name, line in LINES.items():
        command = load(name, COMMANDS).command
        for link in LINKS if "LINK" in line else LINKS[:1]:
            words = line.replace("LINK", link).replace("FOLDER", str(tmp_path / "new")).split()
            words += ["--json"] + ["--rehearse"] * (command.flag("rehearse") is not None)
            if command.word("inventory") is not None:
                words.append(f"inventory={priced}")
            done = preforked.run(words, env=environment)
            reason = _wrong(done.returncode, done.stdout, done.stderr)
            if reason is not None or done.returncode != ENDS.get(name, done.returncode):
                failures.append((" ".join(words), done.returncode, reason))
    assert failures == []


def _wrong(code: int, out: str, err: str) -> str | None:
    """What is wrong with how a command has ended."""
    try:
        printed: dict[str, Any] = json.loads(out)
    except ValueError:
        return f"exit {code}: {out}{err}"
    if code not in set(ExitCode) - {ExitCode.OUR_FAULT} or printed.get("exit") != code:
        return f"exit {code}, printed {printed.get('exit')}: {out}{err}"
    return f"error output: {err}" if "Traceback" in err else None
