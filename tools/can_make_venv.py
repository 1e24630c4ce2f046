"""Prints `yes VERSION` when this Python can make our environment, `no PACKAGE` when it lacks a Debian package to do so.

It is how old Pythons are found out: they print nothing, or fail.
"""

import importlib.util
import os
import sys


def _lacking() -> str:
    """The Debian package that brings ensurepip to this interpreter."""
    version = f"{sys.version_info[0]}.{sys.version_info[1]}"
    distribution = os.path.realpath("/usr/bin/python3") == f"/usr/bin/python{version}"
    return "python3-venv" if distribution else f"python{version}-venv"


if sys.version_info >= (3, 11):  # noqa: UP036 - older Pythons run this file to be told apart
    if importlib.util.find_spec("venv") and importlib.util.find_spec("ensurepip"):
        print("yes", ".".join(map(str, sys.version_info[:3])))
    else:
        print("no", _lacking())
