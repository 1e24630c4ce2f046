"""What the parts of a gateway say that they install and build is what a bundle is made of."""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.computers.bundle.requirements import Library, PackageRequirement, PackageSource, RequirementKey
from atlantis_netcfg.core.errors import NoMatchError
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.operations.bundle import bundle_hosts, has_tokens, host_requirements
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.operations.computers.parts import PARTS, Part


def part(told: Mapping[str, Any]) -> Part:
    return lambda _declaration, _host, _request: told


SOURCE = {"path": "/etc/apt/sources.list.d/ros.list", "content": "deb http://192.0.2.1 focal main\n"}
PIN = {"path": "/etc/apt/preferences.d/ros", "content": "Package: *\n"}
KEY = {"path": "/usr/share/keyrings/ros.gpg", "content_base64": base64.b64encode(b"key").decode(), "fingerprint": "0"}


def test_requirements_of_all_parts_are_combined(declaration: Inventory, tmp_path: Path) -> None:
    host = declaration.hosts["coastal-gateway"]
    parts = {
        "gateway_base": part({"packages": {"packages": [{"name": "chrony", "version": None}, {"name": "locales"}]}}),
        "gateway_ros2": part(
            {
                "packages": {
                    "packages": [{"name": "ros-base", "version": "1*"}, {"name": "locales"}],
                    "sources": [SOURCE],
                    "keys": [KEY],
                    "pins": [PIN],
                    "expected": {"distribution": "ubuntu", "codename": "focal"},
                }
            }
        ),
        "gateway_interop": part({"packages": None, "build": None}),
    }
    wish = host_requirements(declaration, host, Request(state=tmp_path), parts=parts)
    assert wish.packages == (
        PackageRequirement("chrony", None),
        PackageRequirement("locales", None),
        PackageRequirement("ros-base", "1*"),
    )
    assert (wish.sources, wish.pins) == ((PackageSource(**SOURCE),), (PackageSource(**PIN),))
    assert wish.keys == (RequirementKey(KEY["path"], b"key"),)
    assert (wish.distribution, wish.codename) == ("ubuntu", "focal")


def test_library_and_examples_are_required(declaration: Inventory, tmp_path: Path) -> None:
    interop = declaration.pilot.gateways.interop
    assert interop is not None
    assert interop.examples is not None
    assert has_tokens(declaration)
    host = declaration.hosts["coastal-gateway"]
    sealed = host_requirements(declaration, host, Request(state=tmp_path), parts={}).libraries
    assert sealed == tuple(Library(one.url, one.revision) for one in (interop.library, interop.examples))
    opened = host_requirements(declaration, host, Request(state=tmp_path), parts={}, tokens=True).libraries
    assert [one.token for one in opened] == ["EXAMPLE-interop-token"] * 2
    assert "token" not in repr(opened)


def test_every_declared_package_is_required(declaration: Inventory, tmp_path: Path) -> None:
    # The one needs the archive's key, the other is no part of a gateway.
    others = {name: each for name, each in PARTS.items() if name not in {"gateway_ros2", "openvpn_server"}}
    request = Request(state=tmp_path)
    for host in bundle_hosts(declaration, "all"):
        wish = host_requirements(declaration, host, request, parts=others)
        told = [each(declaration, host, request).get("packages") or {} for each in others.values()]
        assert {one.name for one in wish.packages} == {row["name"] for one in told for row in one.get("packages", ())}


def test_control_centre_has_a_bundle_without_ros_and_libraries(declaration: Inventory, tmp_path: Path) -> None:
    (host,) = bundle_hosts(declaration, "scc")
    wish = host_requirements(declaration, host, Request(state=tmp_path))
    assert {"chrony", "nftables", "openvpn"} <= {package.name for package in wish.packages}
    assert not any(package.name.startswith("ros-") for package in wish.packages)
    assert (wish.libraries, wish.sources, wish.codename) == ((), (), None)


def test_selection_without_computers_has_no_bundle(declaration: Inventory) -> None:
    with pytest.raises(NoMatchError, match="`scc-router`: no gateway, control centre or operator station is selected"):
        bundle_hosts(declaration, "scc", ["scc-router"])
