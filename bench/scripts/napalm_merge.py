"""napalm-ros as its page shows it: stage a script as merge candidate, commit it."""

from __future__ import annotations

import json
import ssl
import sys
from pathlib import Path

from napalm import get_network_driver


def main() -> None:
    """Merge the candidate of the job, or only compare it with what runs."""
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    context = ssl.create_default_context(cafile=job["ca"])
    context.check_hostname = False
    device = get_network_driver("ros")(
        job["host"],
        job["user"],
        job["password"],
        timeout=120,
        optional_args={"port": job["port"], "ssl_wrapper": context.wrap_socket},
    )
    device.open()
    device.load_merge_candidate(config=job["text"])
    if job["compare"]:
        difference = device.compare_config()
        print(difference or "no difference")
        device.discard_config()
    else:
        device.commit_config()
        print("committed")
    device.close()


if __name__ == "__main__":
    main()
