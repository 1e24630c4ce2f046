"""Hostile keys of partners in an inventory: each is refused in its own line, or is a name that harms nobody."""

import re
import shutil
from collections.abc import Iterable
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from policy_pilots import SHIPPED

from atlantis_netcfg.inventory import validate
from atlantis_netcfg.vpn.names import NAME

NAMES = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,30}[a-z0-9])?")
SERVED = ("iqua", "udg")
"""Whom a service of the shipped control centre is for: who leaves them out is told so in its file."""
TAKEN = {"default", "members", "server"}
HOSTILE = (
    *("in/esc", "../inesc", "..", ".", "/", "inesc/", "/etc/passwd", "inesc\\..", "inesc.2", ".revoked-x", "-inesc"),
    *("inesc-", "--config", "--", "-", "_", "in_esc", "INESC", "Inesc", "inesc ", " inesc", "in esc", "inesc\n"),
    *("inesc\x00vtt", "\x00", "inesc\r", "inesc\t", "inesc\x1b[2J", "inesc;reboot", "$(reboot)", "`reboot`", "a|b"),
    *("inesc}", "p_inesc", "@inesc", "{ 0.0.0.0/0 }", "inesc, iqua", "10.80.0.0/16", "{{ 7 * 7 }}", "{% raw %}"),
    *("\u0456nesc", "ines\u0441", "in\u00e9sc", "e\u0301ca", "\uff49nesc", "inesc\u200b", "\u202einesc", "\u00adeca"),
    *("\u0661\u0662", "x" * 33, "x" * 49, "x" * 65, "default", "server", "members", "DEFAULT", "'", '"'),
)
HARMLESS = ("log", "ip", "drop", "table", "set", "x" * 32, "0", "007", "a--b", "xn--eca", "null-", "p-members", "no1")
_HEALTH = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
_TEXTS = st.text(min_size=1, max_size=70) | st.from_regex(r"\A[a-z0-9./_ -]{1,50}\Z")


@pytest.fixture
def inventory(tmp_path: Path) -> Path:
    return Path(shutil.copytree(SHIPPED, tmp_path / "inventory"))


def refused(inventory: Path, keys: Iterable[str]) -> set[str]:
    """Which of these keys are told, by line, when all of them are declared."""
    file = inventory / "group_vars" / "all" / "partners.yml"
    lines, at = ["partners:"], {}
    lines += [
        f"  {name}: {{full_name: {name}, vpn_pool: 10.80.250.{8 * n}/29}}"
        for n, name in enumerate(("inesc", "eca", *SERVED))
    ]
    for number, key in enumerate(keys):
        pool = f"10.80.{16 + number // 32}.{number % 32 * 8}/29"
        at[len(lines) + 1] = key
        lines.append(f"  {_quoted(key)}: {{full_name: somebody, vpn_pool: {pool}}}")
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    findings = validate(inventory)
    assert {Path(one.file).name for one in findings} <= {"partners.yml"}
    return {at[one.line] for one in findings}


def _quoted(key: str) -> str:
    return str(yaml.safe_dump(key, default_style='"', width=100000)).strip()


def harmful(keys: Iterable[str]) -> set[str]:
    return {key for key in keys if NAMES.fullmatch(key) is None or key in TAKEN}


def test_hostile_keys_are_refused(inventory: Path) -> None:
    keys = list(HOSTILE)
    assert harmful(keys) == set(keys)
    assert refused(inventory, keys) == set(keys)


def test_overlong_yaml_key_is_refused(inventory: Path) -> None:
    assert refused(inventory, ["x" * 3000, "in/esc"]) == {"x" * 3000}


def test_odd_but_harmless_keys_are_accepted(inventory: Path) -> None:
    keys = [key for key in HARMLESS if not key.endswith("-")]
    assert refused(inventory, keys) == set()
    assert all(NAME.fullmatch(key) for key in keys)


@pytest.mark.parametrize(
    "examples", [pytest.param(8, id="sample"), pytest.param(40, id="campaign", marks=pytest.mark.campaign)]
)
def test_generated_keys_are_refused_only_if_harmful(inventory: Path, examples: int) -> None:
    @settings(max_examples=examples, suppress_health_check=_HEALTH)
    @given(st.lists(_TEXTS, min_size=60, max_size=120, unique=True))
    def each(keys: list[str]) -> None:
        others = [key for key in keys if key not in {"inesc", "eca"}]
        assert refused(inventory, others) == harmful(others)

    each()
