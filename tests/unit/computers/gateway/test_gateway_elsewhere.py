"""Settings that would keep ROS 2 on its own computer are found where people and systems put them."""

from pathlib import Path

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.filesystem import FileSystem
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules import env_conflicts

NAME = "ROS_LOCALHOST_ONLY"
PASSWD = "root:x:0:0:root:/root:/bin/bash\nodroid:x:1000:1000::/home/odroid:/bin/sh\nnobody:x:1:1::/:/bin/false\n"
OURS = "/etc/profile.d/atlantis-rosenv.sh"


def found(root: Path, path: str, text: str) -> list[env_conflicts.Setting]:
    for name, content in {"/etc/passwd": PASSWD, path: text}.items():
        place = root / name[1:]
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(content)
    return env_conflicts.contradicting(FileSystem(str(root)), {NAME: "0"}, frozenset({OURS}))


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("/etc/environment", f"{NAME}=1"),
        ("/etc/environment", f'{NAME}="1"'),
        ("/etc/profile.d/ros.sh", f"export {NAME}=1"),
        ("/etc/profile.d/ros.sh", f"A=b; export B {NAME}='1'; C=d"),
        ("/etc/bash.bashrc", f"  declare -x {NAME}=1 # for a lesson"),
        ("/root/.bashrc", f"export {NAME}=1"),
        ("/home/odroid/.profile", f"{NAME}=1"),
        ("/home/odroid/.pam_environment", f"{NAME} DEFAULT=1"),
        ("/etc/systemd/system.conf.d/ros.conf", f'DefaultEnvironment="A=b" "{NAME}=1"'),
        ("/etc/systemd/system/talker.service", f"Environment={NAME}=1"),
        ("/etc/systemd/system/talker.service.d/10.conf", f"Environment=A=b {NAME}=1"),
    ],
)
def test_conflicting_setting_is_found_anywhere(path: str, line: str, tmp_path: Path) -> None:
    assert found(tmp_path, path, f"# about\n{line}\n") == [env_conflicts.Setting(path, 2, NAME, "1")]


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("/etc/environment", f"{NAME}=0"),
        ("/etc/environment", f"# {NAME}=1"),
        ("/etc/environment", f"MY_{NAME}=1"),
        ("/etc/profile.d/ros.sh", f"echo ${NAME}"),
        ("/home/odroid/notes", f"{NAME}=1"),
        (OURS, f"{NAME}=1"),
    ],
)
def test_harmless_line_is_ignored(path: str, line: str, tmp_path: Path) -> None:
    assert found(tmp_path, path, f"{line}\n") == []


def test_nothing_is_searched_without_variables(tmp_path: Path) -> None:
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc" / "profile").write_text('if [ "$1" = x ]; then :; fi\n')
    assert env_conflicts.contradicting(FileSystem(str(tmp_path)), {}, frozenset()) == []


def test_note_states_place_effect_and_advice() -> None:
    assert env_conflicts.note(env_conflicts.Setting("/etc/environment", 3, NAME, "1"), "ROS 2 stays at home") == (
        "line 3 of /etc/environment sets ROS_LOCALHOST_ONLY=1: ROS 2 stays at home; remove that line and log in again"
    )
