"""`provision check` of a site at which no program sees the VPN and DDS: not green before somebody has looked."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.cli import main

if TYPE_CHECKING:
    from collections.abc import Sequence

pytestmark = pytest.mark.slow

SHIPPED = Path(__file__).parents[4] / "inventory"
UNSEEN = ("scc/site/rogue-dhcp", "scc/site/rogue-router", "scc/site/vpn", "scc/site/data-reaches-scc", "scc/site/dds")
ANSWERS = "name: A. Technician\nsign: true\nanswers:\n" + "".join(f"  {one}: {{verdict: PASS}}\n" for one in UNSEEN)


def without_computer(folder: Path) -> Path:
    """The shipped inventory without the control centre's computer, from which programs would look."""
    made = shutil.copytree(SHIPPED, folder / "inventory")
    (made / "host_vars/scc-control.yml").unlink()
    hosts, pilot = made / "hosts.yml", made / "group_vars/all/pilot.yml"
    text = hosts.read_text().replace("    control_centres:\n      hosts:\n        scc-control:\n", "")
    hosts.write_text(text.replace("            scc-control:\n", ""))
    measured = re.sub(r"(?m)^  qualify:.*\n(?:    .*\n)+", "", pilot.read_text())
    lines = [line for line in measured.splitlines() if "host: scc-control" not in line]
    pilot.write_text(
        "\n".join("    services: []" if line.startswith("    services:") else line for line in lines) + "\n"
    )
    return made


def test_site_without_a_computer_needs_a_person_for_vpn_and_dds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    scc: Sequence[str] = ("check", "site=scc", "--rehearse", f"inventory={without_computer(tmp_path)}")
    assert main([*scc, "--json", "--sign-as", "A. Technician"]) == 6
    told = json.loads(capsys.readouterr().out)
    assert (told["exit"], told["signed"]) == (6, None)
    assert [item["id"] for item in told["items"] if item["open"]] == list(UNSEEN)
    skipped = tmp_path / "skipped.yml"
    skipped.write_text(ANSWERS.replace("scc/site/vpn: {verdict: PASS}", "scc/site/vpn: {verdict: SKIP, note: no time}"))
    assert main([*scc, "--json", "--answers", str(skipped)]) == 3
    assert "`scc/site/vpn` applies at every site: it cannot be skipped" in capsys.readouterr().out
    answers = tmp_path / "answers.yml"
    answers.write_text(ANSWERS)
    assert main([*scc, "--json", "--answers", str(answers)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["exit"], told["signed"]["by"]) == (0, "A. Technician")


def test_control_centre_is_checked_automatically(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    assert main(["check", "site=scc", "--rehearse", "--json"]) == 0
    told = {item["id"]: item for item in json.loads(capsys.readouterr().out)["items"]}
    assert [(told[item]["verdict"], told[item]["kind"]) for item in UNSEEN] == [("PASS", "automatic")] * len(UNSEEN)
    assert told["scc/site/data-reaches-scc"]["title"] == "Data reach every gateway and come back"
    assert told["scc/site/dds"]["title"] == "DDS responds on the control centre"
