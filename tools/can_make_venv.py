"""Prints `yes VERSION` when this Python can make our environment, `no PACKAGE` when it lacks a Debian package to do so.

It is how old Pythons are found out: they print nothing, or fail.
"""

import os
import sys


def _lacking() -> str:
    """The Debian package that brings ensurepip to this interpreter."""
    version = f"{sys.version_info[0]}.{sys.version_info[1]}"
    distribution = os.path.realpath("/usr/bin/python3") == f"/usr/bin/python{version}"
    return "python3-venv" if distribution else f"python{version}-venv"


def _can_make_venv() -> bool:
    """Whether pip can be put into an environment: Debian packs venv, ensurepip and its wheels apart from Python."""
    try:
        import ensurepip  # noqa: PLC0415 - its absence is the answer
        import venv  # noqa: F401, PLC0415 - as above

        ensurepip.version()
    except (ImportError, AttributeError, OSError):
        return False
    return True


if sys.version_info >= (3, 11):  # noqa: UP036 - older Pythons run this file to be told apart
    if _can_make_venv():
        print("yes", ".".join(map(str, sys.version_info[:3])))
    else:
        print("no", _lacking())
