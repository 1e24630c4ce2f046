"""Module `atlantis.netcfg.packages`: install Debian and Ubuntu packages in their desired versions in one round trip."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: packages
short_description: Packages of Debian or Ubuntu, exactly as declared, from whatever state was left behind
description:
  - One call looks, repairs what an interrupted dpkg has left, writes keys, sources and pins, updates the lists if
    something is missing, installs, and reads back with dpkg-query.
  - Needs dpkg, apt and gpgv on the computer; neither gpg nor python3-apt.
  - Where the lists of a source cannot be fetched or are signed by another or an expired key, the files of the source
    are taken back, so that apt stays usable.
author: ATLANTIS pilot team
options:
  packages:
    description: What shall be installed. A version may end in C(*); without one any installed version is good.
    type: list
    elements: dict
    required: true
    suboptions:
      name: {description: Name of the package., type: str, required: true}
      version: {description: Its version., type: str}
  sources:
    description: Files of sources, as apt reads them.
    type: list
    elements: dict
    default: []
    suboptions:
      path: {description: Absolute path., type: str, required: true}
      content: {description: The text., type: str, required: true}
  keys:
    description: Key files of the sources, binary or armoured. Each holds one key.
    type: list
    elements: dict
    default: []
    suboptions:
      path: {description: Absolute path., type: str, required: true}
      content_base64: {description: The file., type: str, required: true}
      fingerprint: {description: Of the key, 40 hex digits., type: str, required: true}
  pins:
    description: Files of preferences.
    type: list
    elements: dict
    default: []
    suboptions:
      path: {description: Absolute path., type: str, required: true}
      content: {description: The text., type: str, required: true}
  absent:
    description: Files that name the same sources in another way; they are removed.
    type: list
    elements: str
    default: []
  expected:
    description: The system that all this is made for; another one is refused. Null is any.
    type: dict
    default: {}
    suboptions:
      codename: {description: VERSION_CODENAME of os-release., type: str}
      distribution: {description: ID of os-release., type: str}
      architectures: {description: As dpkg prints it., type: list, elements: str, default: []}
  offline:
    description:
      - Folder of a bundle on the computer; apt uses nothing else then, and no network.
      - It is a flat repository, C(InRelease), C(Packages) and the packages, with its key in C(atlantis.gpg).
    type: str
  limit_bytes:
    description:
      - More is not downloaded, neither packages nor lists of them; lists that are there are used then. Without lists
        nobody knows what they cost, and nothing is downloaded.
    type: int
  limit_words:
    description: Why; the link in use and what it costs.
    type: str
    default: ""
  notes:
    description: What the declaration has to tell of all this; handed on.
    type: list
    elements: str
    default: []
  wait_s:
    description: How long another apt or dpkg is waited for, in seconds.
    type: int
    default: 300
"""

RETURN = r"""
changes: {description: One line a change., type: list, elements: str, returned: success}
notes: {description: What should be known., type: list, elements: str, returned: success}
versions: {description: The declared packages as dpkg tells them., type: dict, returned: success}
also: {description: What came with them., type: dict, returned: success}
download_bytes: {description: What was downloaded., type: int, returned: success}
"""

EXAMPLES = r"""
- name: Install chrony
  atlantis.netcfg.packages:
    packages: [{name: chrony}]
    expected: {distribution: ubuntu, codename: focal}
"""

from typing import Any

from ansible.module_utils.basic import AnsibleModule

from ..module_utils.apt_converge import AptConvergence, DesiredPackages
from ..module_utils.apt_run import Apt
from ..module_utils.apt_sources import Sources, key_of
from ..module_utils.errors import ModuleError
from ..module_utils.filesystem import FileSystem

_FILE = {"path": {"type": "str", "required": True}, "content": {"type": "str", "required": True}}
ARGUMENTS: dict[str, Any] = {
    "packages": {
        "type": "list",
        "elements": "dict",
        "required": True,
        "options": {"name": {"type": "str", "required": True}, "version": {"type": "str"}},
    },
    "sources": {"type": "list", "elements": "dict", "default": [], "options": _FILE},
    "keys": {
        "type": "list",
        "elements": "dict",
        "default": [],
        "no_log": False,
        "options": {
            "path": {"type": "str", "required": True},
            "content_base64": {"type": "str", "required": True},
            "fingerprint": {"type": "str", "required": True},
        },
    },
    "pins": {"type": "list", "elements": "dict", "default": [], "options": _FILE},
    "absent": {"type": "list", "elements": "str", "default": []},
    "expected": {
        "type": "dict",
        "default": {},
        "options": {
            "codename": {"type": "str"},
            "distribution": {"type": "str"},
            "architectures": {"type": "list", "elements": "str", "default": []},
        },
    },
    "offline": {"type": "str"},
    "limit_bytes": {"type": "int"},
    "limit_words": {"type": "str", "default": ""},
    "notes": {"type": "list", "elements": "str", "default": []},
    "wait_s": {"type": "int", "default": 300},
}


def main() -> None:
    """Run the module."""
    module = AnsibleModule(argument_spec=ARGUMENTS, supports_check_mode=True)
    parameters = module.params
    expected_system = parameters["expected"] or {}
    tree = FileSystem()
    converge = None
    try:
        keys = [key_of(key) for key in parameters["keys"]]
        texts = {file["path"]: file["content"].encode() for file in [*parameters["pins"], *parameters["sources"]]}
        sources = Sources(tree, {**{key.path: key.content for key in keys}, **texts}, parameters["absent"])
        desired_packages = DesiredPackages(
            {package["name"]: package["version"] for package in parameters["packages"]},
            keys,
            expected_system.get("codename"),
            expected_system.get("distribution"),
            expected_system.get("architectures") or (),
            parameters["limit_bytes"],
            parameters["limit_words"],
        )
        diffs = {path: sources.before_and_after(path) for path in [*sources.changed_paths, *sources.conflicting_paths]}
        converge = AptConvergence(Apt(tree, parameters["offline"], parameters["wait_s"]), sources, desired_packages)
        outcome = converge.run(check=module.check_mode)
    except ModuleError as why:
        changes = converge.list_changes() if converge is not None else []
        module.fail_json(msg=why.message, hint=why.hint, changes=changes, changed=bool(changes))
        return
    module.exit_json(
        changed=bool(outcome.changes),
        changes=outcome.changes,
        notes=[*parameters["notes"], *outcome.notes],
        versions=outcome.versions,
        also=outcome.also,
        download_bytes=outcome.download_bytes,
        diff=[
            {"before": before, "after": after, "before_header": path, "after_header": path}
            for path, (before, after) in diffs.items()
        ],
    )


if __name__ == "__main__":
    main()
