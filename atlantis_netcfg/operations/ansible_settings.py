"""What Ansible reads when it is imported: our configuration, and a folder of ours for its temporary files."""

from __future__ import annotations

import atexit
import os
from contextlib import ExitStack
from functools import cache
from importlib import import_module

from atlantis_netcfg import paths, temporary

__all__ = ["import_ansible"]


@cache
def import_ansible() -> None:
    """Import Ansible's settings with ours, once a process; what we start later does not inherit them.

    The folder for its temporary files goes when the process ends.
    """
    stack = ExitStack()
    atexit.register(stack.close)
    ours = {
        "ANSIBLE_CONFIG": str(paths.checkout() / "ansible.cfg"),
        "ANSIBLE_LOCAL_TEMP": str(stack.enter_context(temporary.folder("run"))),
        "ANSIBLE_NOCOLOR": "1",
        "ANSIBLE_STDOUT_CALLBACK": "atlantis.netcfg.events",
    }
    before = {name: os.environ.get(name) for name in ours}
    os.environ.update(ours)
    try:
        import_module("ansible.constants")
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
