"""Names of a package that are imported when they are asked for: a command loads only what it uses."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


def homes(package: str, names: Mapping[str, tuple[str, ...]]) -> Callable[[str], Any]:
    """Make the `__getattr__` of a package (PEP 562) from its modules and the names that each is home to."""
    home = {name: f"{package}.{module}" for module, local in names.items() for name in local}

    def find(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(home[name]), name)

    return find
