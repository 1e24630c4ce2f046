"""`provision version`: what to quote in a question to us."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command
from atlantis_netcfg.core.errors import ExitCode

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments

COMMAND = Command("version", "print the versions of provision, Python and ansible-core", flags=(JSON,))


def run(arguments: Arguments) -> ExitCode:
    """Print the versions without importing what they belong to."""
    versions = _versions()
    if arguments.flag("json"):
        import json

        print(json.dumps({"exit": int(ExitCode.DONE), "errors": [], "versions": versions}))
    else:
        print("\n".join(f"{name} {version}" for name, version in versions.items()))
    return ExitCode.DONE


def _versions() -> dict[str, str]:
    import platform
    from importlib import metadata

    from atlantis_netcfg import __version__

    return {
        "provision": __version__,
        "Python": platform.python_version(),
        "ansible-core": metadata.version("ansible-core"),
    }
