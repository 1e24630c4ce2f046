"""What is said of a terminal that nobody can ask."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Any

import pytest
import yaml

from atlantis_netcfg.bearers.satellite import (
    Backup,
    Capability,
    ManualTerminal,
    SatelliteEvidence,
    SatTerminal,
    Unsupported,
    judge_evidence,
)

CASES: list[dict[str, Any]] = yaml.safe_load(Path(__file__).with_name("satellite_cases.yml").read_text("utf-8"))
TODAY = date(2026, 11, 21)


def evidence(seen_on: str = "2026-11-01", backup: str | None = None, *, allow_list: bool = True) -> SatelliteEvidence:
    return SatelliteEvidence(
        firmware="1.2.3",
        allow_list=allow_list,
        by="INESC",
        seen_on=date.fromisoformat(seen_on),
        backup_file=None if backup is None else "sat.bin",
        backup_sha256=None if backup is None else backup * 64,
    )


@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case["case"]))
def test_evidence_is_judged(case: dict[str, Any]) -> None:
    declared = None if case["evidence"] is None else evidence(**case["evidence"])
    file = Backup("evidence/sat.bin", case["file"] * 64) if "file" in case else None
    found = judge_evidence("coastal-sat", declared, file, case.get("confirmed"), TODAY)
    assert [[one.verdict.value, one.code, one.message] for one in found] == case["told"]
    assert all(one.hint for one in found)


def test_a_terminal_without_an_interface_answers_what_is_declared_and_asks_for_the_rest() -> None:
    nobody: SatTerminal = ManualTerminal("coastal-sat")
    assert nobody.capabilities == frozenset()
    known: SatTerminal = ManualTerminal("coastal-sat", evidence(backup="1", allow_list=False))
    answers = {capability: known.read(capability) for capability in known.capabilities}
    assert answers == {
        Capability.FIRMWARE: "1.2.3",
        Capability.FIREWALL_READBACK: "not as declared",
        Capability.BACKUP_EXPORT: "sat.bin",
    }
    for terminal in (nobody, known):
        for capability in set(Capability) - terminal.capabilities:
            with pytest.raises(Unsupported, match="coastal-sat has no interface to ask") as refused:
                terminal.read(capability)
            assert refused.value.hint
            assert "coastal-sat" in refused.value.hint
            assert refused.value.hint.endswith("?")
