"""Module `atlantis.netcfg.build`: the interoperability library and its examples, built once per revision."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: build
short_description: Build a git revision of the interoperability library and its examples, once
description:
  - Fetches both repositories with their submodules, builds the library by colcon and the examples by cmake and make,
    looks whether what was built finds its libraries, and only then lets C(PREFIX/current) lead to it.
    C(PREFIX/previous) leads to the build that was in use before; declaring its revisions again takes it back into use
    without building. Older builds are removed.
  - A build is known by both revisions, the ROS 2 distribution and the compiler. It is complete when its C(build.json)
    is there, which is written last; with whatever was cut off, the next run goes on.
  - The build is a transient unit of systemd, C(atlantis-build-KEY), and goes on without the SSH session that started
    it. The module does not wait. The caller waits until the unit has ended, and calls again with O(started); a second
    run that comes while it works joins it. What it says stands in C(/var/log/atlantis/build-KEY.log).
  - A token is told to git alone, for the server of its repository, from a file in memory that is gone when everything
    is fetched. Submodules on the same server are read with it.
  - With O(offline) no server is asked. Every repository, and every submodule at any depth, stands as a bare repository
    in C(OFFLINE/git/SERVER/PATH.git), SERVER and PATH as its URL has them (C(git/gitlab.example.org/c4i/library.git);
    a port belongs to SERVER), with the declared tag as C(refs/tags/TAG), and every commit that is declared, or that a
    submodule stands at, under some reference. History is not needed (C(git fetch --depth 1)).
  - In check mode it tells whether it would build, or take another build into use.
options:
  library:
    description: The repository of the library, a workspace of colcon.
    type: dict
    required: true
    suboptions: &repository
      url: {description: By https or http., type: str, required: true}
      revision: {description: "A tag, or a commit by all of its digits; no branch.", type: str, required: true}
      token: {description: "Access token, or NAME:TOKEN where it goes with a name.", type: str}
  examples:
    description: The repository of the examples, a project of cmake. None are built if omitted.
    type: dict
    suboptions: *repository
  ros_setup: {description: "What is sourced first, C(/opt/ros/DISTRIBUTION/setup.sh).", type: str, required: true}
  prefix: {description: Where the builds stand., type: str, default: /opt/atlantis/interop}
  jobs: {description: "Compilers at once, at most; never more than cores, or than fit into the free memory.", type: int}
  offline: {description: The folder that stands for all servers., type: str}
  started: {description: "The RV(run) whose end is to be told: nothing is started then.", type: str}
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Start building the library, or find it built
  atlantis.netcfg.build:
    library:
      url: https://gitlab.example.org/c4i/uv-interoperability.git
      revision: v1.0.0
      token: "{{ interop_token }}"
    ros_setup: /opt/ros/foxy/setup.sh
  register: interop_build
"""

RETURN = r"""
changes:
  description: One line for each change.
  type: list
  elements: str
  returned: always
  sample: ["build of library v1.0.0 and examples v1.0.0 started", "build 2a5c07d4c3b1 of library v1.0.0 taken into use"]
notes:
  description: What a person should know, like a tag that has moved.
  type: list
  elements: str
  returned: always
state:
  description: C(ready), C(running), or, in check mode only, C(wanted).
  type: str
  returned: on success
run:
  description: The name of the run that works.
  type: str
  returned: while it works
unit:
  description: The unit of systemd to wait for.
  type: str
  returned: on success, where there is a compiler
log:
  description: All that the build has said.
  type: str
  returned: on success, where there is a compiler
commits:
  description: What the revisions led to.
  type: dict
  returned: when ready
hint:
  description: What to do about a failure.
  type: str
  returned: on failure
"""

from typing import Any

from ansible.module_utils.basic import AnsibleModule

from ..module_utils.build_plan import Repository
from ..module_utils.build_start import Build, BuildFolders
from ..module_utils.errors import ModuleError

_TEXT = {"type": "str", "required": True}
_REPOSITORY = {"url": _TEXT, "revision": _TEXT, "token": {"type": "str", "no_log": True}}
ARGUMENTS: dict[str, Any] = {
    "library": {"type": "dict", "required": True, "options": _REPOSITORY},
    "examples": {"type": "dict", "options": _REPOSITORY},
    "ros_setup": _TEXT,
    "prefix": {"type": "str", "default": "/opt/atlantis/interop"},
    "jobs": {"type": "int"},
    "offline": {"type": "str"},
    "started": {"type": "str"},
}


def main() -> None:
    """Run the module."""
    module = AnsibleModule(ARGUMENTS, supports_check_mode=True)
    data = module.params
    parameters_by_name = {name: data[name] for name in ("library", "examples") if data[name] is not None}
    repositories = {name: Repository(entry["url"], entry["revision"]) for name, entry in parameters_by_name.items()}
    build = Build(
        repositories["library"],
        repositories.get("examples"),
        {name: item["token"] for name, item in parameters_by_name.items()},
        data["ros_setup"],
        data["jobs"],
        data["offline"],
        module.check_mode,
        BuildFolders(data["prefix"]),
    )
    try:
        result = build.visit(data["started"])
    except ModuleError as refused:
        values = {"changed": bool(build.changes), "changes": build.changes, "notes": build.notes}
        module.fail_json(msg=refused.message, hint=refused.hint, **values)
    module.exit_json(changed=bool(build.changes), changes=build.changes, notes=build.notes, **result)


if __name__ == "__main__":
    main()
