"""Action `atlantis.netcfg.minimum_version`: stands before the module of that name, which documents it."""

from __future__ import annotations

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.zipapp_action import ZipappAction


class ActionModule(ZipappAction):
    """The module `minimum_version`, run out of the tool that the computer keeps."""

    module = "minimum_version"
