"""`provision check` of a site at which no program sees the VPN and DDS: not green before somebody has looked."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.cli import main

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

SCC = ("check", "site=scc", "--rehearse")
UNSEEN = ("scc/site/rogue-dhcp", "scc/site/vpn", "scc/site/dds")
ANSWERS = "name: A. Technician\nsign: true\nanswers:\n" + "".join(f"  {one}: {{verdict: PASS}}\n" for one in UNSEEN)


def test_the_control_centre_is_not_green_with_vpn_and_dds_unseen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    assert main([*SCC, "--json", "--sign-as", "A. Technician"]) == 6
    told = json.loads(capsys.readouterr().out)
    assert (told["exit"], told["signed"]) == (6, None)
    assert [item["id"] for item in told["items"] if item["open"]] == list(UNSEEN)
    skipped = tmp_path / "skipped.yml"
    skipped.write_text(ANSWERS.replace("scc/site/vpn: {verdict: PASS}", "scc/site/vpn: {verdict: SKIP, note: no time}"))
    assert main([*SCC, "--json", "--answers", str(skipped)]) == 3
    assert "`scc/site/vpn` applies at every site: it cannot be skipped" in capsys.readouterr().out
    answers = tmp_path / "answers.yml"
    answers.write_text(ANSWERS)
    assert main([*SCC, "--json", "--answers", str(answers)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["exit"], told["signed"]["by"]) == (0, "A. Technician")
