"""Lazy imports of a package's names: a command loads only the modules that it uses."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


def lazy_getattr(package: str, names: Mapping[str, tuple[str, ...]]) -> Callable[[str], Any]:
    """Build a package's `__getattr__` (PEP 562) from its modules and the names that each defines."""
    home = {name: f"{package}.{module}" for module, local in names.items() for name in local}

    def find(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
        if name not in home:
            raise AttributeError(msg(f"module {arg(package)!r} has no attribute {arg(name)!r}"))
        return getattr(import_module(home[name]), name)

    return find
