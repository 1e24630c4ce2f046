"""Action `atlantis.netcfg.env_conflicts`: stands before the module of that name, which documents it."""

from __future__ import annotations

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.zipapp_action import ZipappAction


class ActionModule(ZipappAction):
    """The module `env_conflicts`, run out of the tool that the gateway keeps."""

    module = "env_conflicts"
