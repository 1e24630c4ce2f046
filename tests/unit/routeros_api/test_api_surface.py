from __future__ import annotations

from atlantis_netcfg.core.errors import DeviceFailed, ExitCode
from atlantis_netcfg.routeros import api


def test_the_public_surface() -> None:
    assert api.__all__ == [
        *("READING_WINDOW", "WINDOW", "CertificateChanged", "CertificateUnknown", "Command", "Endpoint"),
        *("FellSilent", "LoginRefused", "ProtocolError", "Refused", "Reply", "Session", "SessionLost"),
        *("Traffic", "Trap", "Unreachable", "certificate_of", "may_cut_off", "shown_certificate"),
    ]


def test_every_error_ends_a_run_as_a_failed_device() -> None:
    errors = [getattr(api, name) for name in api.__all__ if isinstance(getattr(api, name), type)]
    kinds = [kind for kind in errors if issubclass(kind, Exception)]
    assert len(kinds) == 8
    assert all(issubclass(kind, DeviceFailed) and kind.exit == ExitCode.FAILED for kind in kinds)
