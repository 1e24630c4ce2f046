"""Reads devices with librouteros, and knows nothing of us: one job a line in, one answer a line out.

Runs in `.venv-strangers`. A job is `{"host", "port", "user", "password", "ca", "menus"}`; a menu that the device does
not have is null in the answer, a device that does not answer is `{"error": ...}`.
"""

import json
import ssl
import sys
from typing import Any

from librouteros import connect
from librouteros.exceptions import LibRouterosError, TrapError


def main() -> None:
    for line in sys.stdin:
        try:
            answer = read(json.loads(line))
        except (OSError, LibRouterosError) as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()


def read(job: dict[str, Any]) -> dict[str, Any]:
    context = ssl.create_default_context(cafile=job["ca"])
    context.check_hostname = False
    api = connect(
        host=job["host"],
        port=job["port"],
        username=job["user"],
        password=job["password"],
        ssl_wrapper=context.wrap_socket,
        encoding="utf-8",
        timeout=job["timeout_s"],
    )
    try:
        return {menu: _menu(api, menu) for menu in job["menus"]}
    finally:
        api.close()


def _menu(api: Any, menu: str) -> list[dict[str, Any]] | None:  # noqa: ANN401 - no types there
    try:
        return list(api.path(*menu.split("/")))
    except TrapError:
        return None


if __name__ == "__main__":
    main()
