"""Module `atlantis.netcfg.bundle`: the board's end of carrying a bundle; `atlantis.netcfg.carry` calls it."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: bundle
short_description: Say what of a bundle is missing on a computer, and put it together when nothing is
description:
  - Takes in what was uploaded, also of an upload that was cut off, compares each file with its SHA-256, and puts the
    bundle together in C(/var/lib/atlantis/bundle/ID) once it is whole. Older bundles are removed then.
  - Content that the computer has from an earlier bundle is not missing.
options:
  id: {description: The bundle., type: str, required: true}
  files:
    description: What it consists of here. Left out, what was told when it was put together is compared.
    type: list
    elements: dict
    suboptions:
      path: {description: Below the folder of the bundle., type: str, required: true}
      size: {description: In bytes., type: int, required: true}
      sha256: {description: Of its content., type: str, required: true}
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Ask whether a bundle is on the computer
  atlantis.netcfg.bundle:
    id: 0123456789abcdef
"""

RETURN = r"""
ready: {description: Whether it is whole., type: bool, returned: success}
known: {description: Whether the computer was told what it consists of., type: bool, returned: success}
missing: {description: SHA-256 of what is missing., type: list, elements: str, returned: success}
path: {description: The folder of the bundle., type: str, returned: success}
upload: {description: Where a tar archive of what is missing goes to., type: str, returned: success}
changes: {description: One line a change., type: list, elements: str, returned: success}
"""

import os
import re
from typing import Any

from ansible.module_utils.basic import AnsibleModule

from ..module_utils.bundle_store import FOLDER, Store, StoredFile
from ..module_utils.refused import Refused

ARGUMENTS: dict[str, Any] = {
    "id": {"type": "str", "required": True},
    "files": {
        "type": "list",
        "elements": "dict",
        "options": {
            "path": {"type": "str", "required": True},
            "size": {"type": "int", "required": True},
            "sha256": {"type": "str", "required": True},
        },
    },
}


def main() -> None:
    """Answer Ansible."""
    module = AnsibleModule(argument_spec=ARGUMENTS, supports_check_mode=True)
    name, result = module.params["id"], module.params["files"]
    files = tuple(StoredFile(**entry) for entry in result) if result is not None else None
    if not re.fullmatch(r"[0-9a-f]{16}", name) or any(".." in item.path.split("/") for item in files or ()):
        module.fail_json(msg="this is no bundle", hint="", changes=[])
    owner = os.environ.get("SUDO_UID", "")
    store = Store(FOLDER, int(owner) if owner.isdigit() else None)
    try:
        settled = store.settle(name, files, check=module.check_mode)
    except Refused as why:
        module.fail_json(msg=why.message, hint=why.hint, changes=[])
        return
    module.exit_json(
        changed=bool(settled.changes),
        changes=list(settled.changes),
        ready=settled.ready,
        known=settled.known,
        missing=list(settled.missing),
        path=f"{FOLDER}/{name}",
        upload=store.upload(name),
    )


if __name__ == "__main__":
    main()
