"""Action `atlantis.netcfg.bundle_copy`: copy a bundle to the host of this task, sending only missing files.

It opens the bundle, queries the board, and sends the missing files as one archive. When the link breaks, files that
arrived whole are kept, and the next run sends the rest. In check mode nothing is sent.

Arguments: `bundle`, its folder on this computer; `state`, the state directory if not the default; `metered`, the name
of the link if it is metered: nothing is sent over it without consent, given by the argument `accept_cost` or by
Ansible's variable `atlantis_accept_cost`.

Results: `path` on the board, `repository` and `sources` below it, `ready`, `carried_bytes`, `changes`; in check mode
`ready` is false if the bundle is not on the board yet, and `carried_bytes` is what would be sent.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ansible.errors import AnsibleError
from ansible.plugins.action import ActionBase

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.zipapp_action import ZipappAction
from atlantis_netcfg.core import remote_messages, temporary
from atlantis_netcfg.core.errors import DeviceError, NetcfgError
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.stored_messages import pack

if TYPE_CHECKING:
    from atlantis_netcfg.computers.bundle.open import Bundle

_MEGABYTE = 1_000_000


class ActionModule(ZipappAction):
    """Copies a bundle to one host; a bundle that is already there costs one round trip."""

    TRANSFERS_FILES = False
    _supports_check_mode = True
    _supports_async = False
    _VALID_ARGS = frozenset({"bundle", "state", "metered", "accept_cost"})

    def run(self, tmp: Any = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:  # noqa: ANN401
        """Query the board, send the missing files, and let the board assemble the bundle."""
        result: dict[str, Any] = ActionBase.run(self, tmp, task_vars)
        try:
            return {**result, **self._copy(task_vars or {})}
        except NetcfgError as error:
            text = join("\n", filter(None, (error, error.hint)))
            return {**result, **pack({"failed": True, "msg": text})}

    def _copy(self, variables: dict[str, Any]) -> dict[str, Any]:
        host = str(variables["inventory_hostname"])
        bundle = self._open_bundle()
        if host not in bundle.manifest.hosts:
            raise DeviceError(f"the bundle was made for {arg(join(', ', bundle.manifest.hosts))}, not for {arg(host)}")
        values = self._query_status(bundle, None, variables)
        if not values.get("failed") and not values["known"]:
            values = self._query_status(bundle, host, variables)
        carried_bytes = 0
        if not values.get("failed") and values["missing"]:
            carried_bytes, values = self._send(bundle, host, values, variables)
        if not values.get("failed"):
            answer = remote_messages.unpack(values)
            more = _result(bundle, answer, carried_bytes, is_sent=not self._task.check_mode)
            values = pack({**answer, **more})
        return values

    def _open_bundle(self) -> Bundle:
        from atlantis_netcfg.computers.bundle.manifest import Keys  # noqa: PLC0415
        from atlantis_netcfg.computers.bundle.open import open_bundle  # noqa: PLC0415
        from atlantis_netcfg.core import paths  # noqa: PLC0415 - Ansible imports every action plugin

        state = self._task.args.get("state")
        keys = Keys.of(Path(state) if state else paths.state_dir())
        return open_bundle(Path(self._task.args["bundle"]), keys)

    def _query_status(self, bundle: Bundle, host: str | None, variables: dict[str, Any]) -> dict[str, Any]:
        """Query the bundle's state on the board; with `host`, also send the board the list of the bundle's files."""
        arguments: dict[str, Any] = {"id": bundle.manifest.id}
        if host is not None:
            files = bundle.manifest.of(host).items()
            arguments["files"] = [{"path": path, "size": file.size, "sha256": file.sha256} for path, file in files]
        return self.run_module("bundle", arguments, variables)

    def _require_consent(self, size: int, variables: dict[str, Any]) -> None:
        """Raise an error if the transfer goes over a metered link without the user's consent."""
        from atlantis_netcfg.operations.common.costs import accepting  # noqa: PLC0415 - Ansible imports every action plugin
        from atlantis_netcfg.operations.common.request import PLAIN_ANSIBLE, of_variables  # noqa: PLC0415 - as above

        link_name = self._task.args.get("metered")
        if link_name and not of_variables(variables).get("accept_cost", self._task.args.get("accept_cost", False)):
            command = (variables.get("atlantis_request") or {}).get("command", PLAIN_ANSIBLE)
            raise DeviceError(
                f"{arg(_size(size))} of the bundle would go over metered link {arg(link_name)}, and nobody has "
                f"consented to the cost: nothing was sent\nrun the same command with {arg(accepting(command))}, or "
                "use another link: `via=lan`"
            )

    def _send(
        self, bundle: Bundle, host: str, values: dict[str, Any], variables: dict[str, Any]
    ) -> tuple[int, dict[str, Any]]:
        """Send the missing files; return the number of bytes sent and the board's response."""
        from atlantis_netcfg.computers.bundle.open import bytes_to_carry  # noqa: PLC0415 - Ansible imports every action plugin

        missing_hashes = set(values["missing"])
        there = {file.sha256 for file in bundle.manifest.of(host).values()} - missing_hashes
        size = bytes_to_carry(bundle, host, there)
        if self._task.check_mode:
            return size, values
        self._require_consent(size, variables)
        try:
            with temporary.folder("carry", temporary.large_temp_dir()) as folder:
                archive = folder / "archive"
                bundle.pack(host, missing_hashes, archive)
                self._connection.put_file(str(archive), values["upload"])
        except AnsibleError as error:
            raise DeviceError(
                f"the link to {arg(host)} was lost while {arg(_size(size))} of the bundle were copied: "
                f"{arg(error)}\nrun the same command again: it keeps what has arrived and sends only the rest"
            ) from error
        except OSError as error:
            raise DeviceError(
                f"the files to copy cannot be put together in {arg(temporary.large_temp_dir())}: "
                f"{arg(error.strerror or error)}\nfree {arg(_size(size))} there, on this computer"
            ) from error
        answer = self._query_status(bundle, host, variables)
        if not answer.get("failed") and not answer["ready"]:
            raise DeviceError(
                f"{arg(len(answer['missing']))} files of the bundle did not arrive completely on {arg(host)}\nrun "
                "the same command again"
            )
        return size, answer


def _size(size: int) -> str:
    return msg(f"{arg(size / 1e6):.1f} MB" if size >= _MEGABYTE else f"{arg(size / 1000):.0f} kB")


def _result(bundle: Bundle, values: dict[str, Any], carried_bytes: int, *, is_sent: bool) -> dict[str, Any]:
    words = "carried" if is_sent else "to copy"
    changes = (
        [msg(f"bundle {arg(bundle.manifest.id)}: {arg(_size(carried_bytes))} {arg(words)}")] if carried_bytes else []
    )
    changes += values["changes"]
    return {
        "changed": bool(changes),
        "changes": changes,
        "carried_bytes": carried_bytes,
        "repository": f"{values['path']}/repository",
        "sources": f"{values['path']}/sources",
    }
