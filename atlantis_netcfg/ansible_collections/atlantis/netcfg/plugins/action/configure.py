"""Action `atlantis.netcfg.configure`: stands before the module of that name, which documents it."""

from __future__ import annotations

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.zipapp_action import ZipappAction


class ActionModule(ZipappAction):
    """The module `configure`, run out of the tool that the gateway keeps."""

    module = "configure"
