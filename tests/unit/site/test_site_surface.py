from __future__ import annotations

import inspect
import pkgutil
import subprocess
import sys
from importlib import import_module

import pytest

import atlantis_netcfg.declaration
from atlantis_netcfg.declaration import rules


def test_public_surface() -> None:
    assert sorted(atlantis_netcfg.declaration.__all__) == [
        *("ALL", "Declaration", "Finding", "Host", "InventoryInvalid", "Mark", "choose", "load"),
        *("report", "validate"),
    ]
    assert all(hasattr(atlantis_netcfg.declaration, name) for name in atlantis_netcfg.declaration.__all__)


def test_unknown_name() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'lode'"):
        getattr(atlantis_netcfg.declaration, "lode")  # noqa: B009 - mypy knows that it is not there


def test_importing_it_imports_nothing_heavy() -> None:
    heavy = "('pydantic', 'yaml', 'jinja2')"
    program = f"import sys, atlantis_netcfg.declaration; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_rule_is_in_use() -> None:
    written = []
    for info in pkgutil.iter_modules(rules.__path__):
        if info.name.startswith("_"):
            continue
        module = import_module(f"{rules.__name__}.{info.name}")
        for name, function in inspect.getmembers(module, inspect.isfunction):
            signature = inspect.signature(function)
            own = function.__module__ == module.__name__ and not name.startswith("_")
            if own and signature.return_annotation == "Iterator[Finding]":
                assert list(signature.parameters) == ["draft"], function
                written.append(function)
    in_use = (*rules.RULES, *rules.WARNINGS)
    assert set(written) == set(in_use)
    assert len(in_use) == len(written)


def test_every_rule_says_what_must_hold() -> None:
    assert [rule.__name__ for rule in (*rules.RULES, *rules.WARNINGS) if not (rule.__doc__ or "").strip()] == []
