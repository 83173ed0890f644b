"""`ecatctl service` in the file system of an image: what it writes, keeps and removes."""

import json
import os
import re
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from conftest import run_module

PROGRAMS = Path(sysconfig.get_path("scripts"))
UNIT = "etc/systemd/system/ecatd.service"
UNIT_OF_BUS = "etc/systemd/system/ecatd@.service"
LIST = "usr/local/share/ecatd/installed.json"
CONFIGURATION = "etc/ecatd/ecat0.toml"


def service(root: Path, *arguments: str, status: int = 0) -> str:
    """What `ecatctl service` prints for an image."""
    done = run_module("ecatd.cli", "service", *arguments, "--root", str(root))
    assert done.returncode == status, done
    return done.stdout + done.stderr


def tree(root: Path) -> dict[str, tuple[bytes, int]]:
    """Content and time of all files."""
    return {
        str(path.relative_to(root)): (
            (str(path.readlink()).encode(), 0)
            if path.is_symlink()
            else (path.read_bytes(), path.stat().st_mtime_ns)
        )
        for path in root.rglob("*")
        if path.is_symlink() or not path.is_dir()
    }


def test_all_parts_are_put_into_place(tmp_path: Path) -> None:
    told = service(tmp_path, "install", "--interface", "eth7")
    found = tree(tmp_path)
    assert {
        UNIT,
        UNIT_OF_BUS,
        "etc/systemd/network/10-ecatd.network",
        "etc/udev/rules.d/85-ecatd.rules",
        "etc/sysusers.d/ecatd.conf",
        "usr/local/lib/systemd/catalog/ecatd.catalog",
        "usr/local/share/man/man1/ecatctl.1",
        "usr/local/share/bash-completion/completions/ecatctl",
        "usr/local/share/zsh/site-functions/_ecatctl",
        "usr/local/share/fish/vendor_completions.d/ecatctl.fish",
        "usr/local/share/ecatd/monitoring/grafana.json",
        "usr/local/share/doc/ecatd/ecat0.toml",
        CONFIGURATION,
    } <= set(found)
    for unit in (UNIT, UNIT_OF_BUS):
        (program,) = re.findall(r"^ExecStart=(\S+)", found[unit][0].decode(), re.MULTILINE)
        assert program == str(PROGRAMS / "ecatd")
    assert found["usr/local/bin/ecatctl"][0].decode() == str(PROGRAMS / "ecatctl")
    assert "usermod -aG ecat" in told
    for path in found:
        assert f"/{path}" in told
        assert (tmp_path / path).is_symlink() or (tmp_path / path).stat().st_mode & 0o777 == 0o644


def test_the_configuration_is_a_valid_one(tmp_path: Path) -> None:
    service(tmp_path, "install", "--interface", "eth7", "--bus", "press")
    file = tmp_path / "etc/ecatd/press.toml"
    assert 'interface = "eth7"' in file.read_text()
    assert 'bus = "press"' in file.read_text()
    check = [PROGRAMS / "ecatd", "--config", file, "--check-config"]
    assert subprocess.run(check, check=False).returncode == 0


def test_without_an_interface_it_says_how_to_go_on(tmp_path: Path) -> None:
    told = service(tmp_path, "install")
    assert not (tmp_path / CONFIGURATION).exists()
    assert "ecatctl service install --interface IF" in told


def test_a_dry_run_writes_nothing_and_says_the_same(tmp_path: Path) -> None:
    would = service(tmp_path, "install", "--dry-run")
    assert tree(tmp_path) == {}
    did = service(tmp_path, "install")
    steps = [line for line in did.splitlines() if not line.startswith("next:")]
    assert [re.sub(r"^would ", "", line).split()[:2] for line in would.splitlines()] == [
        line.split()[:2] for line in steps
    ]


def test_once_more_changes_nothing(tmp_path: Path) -> None:
    service(tmp_path, "install", "--interface", "eth7")
    before = tree(tmp_path)
    told = service(tmp_path, "install", "--interface", "eth8")
    assert tree(tmp_path) == before
    assert not re.search(r"^(write|link|remove) ", told, re.MULTILINE)


def test_an_upgrade_brings_files_up_to_date_and_keeps_what_is_yours(tmp_path: Path) -> None:
    service(tmp_path, "install", "--interface", "eth7")
    configuration = tmp_path / CONFIGURATION
    configuration.write_text('interface = "eth9"\n')
    # As an older version had it: another unit, and a file that this version does not have.
    listed = json.loads((tmp_path / LIST).read_text())
    import hashlib

    old = b"[Unit]\nDescription=older\n"
    for name in (UNIT, "etc/udev/rules.d/70-ecatd.rules"):
        (tmp_path / name).write_bytes(old)
        listed["files"][f"/{name}"] = hashlib.sha256(old).hexdigest()
    (tmp_path / LIST).write_text(json.dumps(listed))
    own = tmp_path / UNIT_OF_BUS
    own.write_text("# written by the administrator\n")
    told = service(tmp_path, "upgrade")
    assert b"older" not in (tmp_path / UNIT).read_bytes()
    assert not (tmp_path / "etc/udev/rules.d/70-ecatd.rules").exists()
    assert not (tmp_path / f"{UNIT}.before-ecatd").exists()
    saved = tmp_path / f"{UNIT_OF_BUS}.before-ecatd"
    assert saved.read_text() == "# written by the administrator\n"
    assert "ExecStart=" in own.read_text()
    assert f"/{UNIT_OF_BUS}.before-ecatd" in told
    assert configuration.read_text() == 'interface = "eth9"\n'


def test_it_removes_what_it_wrote_and_nothing_else(tmp_path: Path) -> None:
    other = tmp_path / "etc/systemd/system/other.service"
    other.parent.mkdir(parents=True)
    other.write_text("[Service]\n")
    program = tmp_path / "usr/local/bin/ecatsim"
    program.parent.mkdir(parents=True)
    program.write_text("# another program\n")
    service(tmp_path, "install", "--interface", "eth7")
    assert program.read_text() == "# another program\n"
    told = service(tmp_path, "uninstall")
    left = {CONFIGURATION, str(other.relative_to(tmp_path)), str(program.relative_to(tmp_path))}
    assert set(tree(tmp_path)) == left
    assert "--purge" in told
    service(tmp_path, "uninstall", "--purge")
    assert set(tree(tmp_path)) == left - {CONFIGURATION}
    assert not (tmp_path / "etc/ecatd").exists()


def test_what_cannot_be_done_is_refused(tmp_path: Path) -> None:
    assert "no service is installed" in service(tmp_path, "upgrade", status=7)
    assert "no service is installed" in service(tmp_path, "uninstall", status=7)
    assert "is no folder" in service(tmp_path / "absent", "install", status=2)
    assert "network interface" in service(tmp_path, "install", "--interface", 'a"b', status=2)
    assert "bus name" in service(tmp_path, "install", "--bus", "a/b", status=2)
    assert "is for install" in service(tmp_path, "upgrade", "--interface", "eth7", status=2)
    assert "is for uninstall" in service(tmp_path, "install", "--purge", status=2)
    assert tree(tmp_path) == {}
    service(tmp_path, "install")
    (tmp_path / LIST).write_text("[]")
    assert "installed.json is damaged" in service(tmp_path, "uninstall", status=7)


def test_a_folder_in_place_of_a_file_stays(tmp_path: Path) -> None:
    (tmp_path / UNIT).mkdir(parents=True)
    told = service(tmp_path, "install")
    assert re.search(rf"^keep +/{UNIT} ", told, re.MULTILINE)
    service(tmp_path, "uninstall")
    assert (tmp_path / UNIT).is_dir()


def test_a_mistake_in_your_configuration_is_told(tmp_path: Path) -> None:
    file = tmp_path / CONFIGURATION
    file.parent.mkdir(parents=True)
    file.write_text("cycle_time = 1\n")
    assert re.search(
        r"^keep +/etc/ecatd/ecat0.toml .*mistake.*cycle_time",
        service(tmp_path, "install"),
        re.MULTILINE,
    )


def test_json(tmp_path: Path) -> None:
    document = json.loads(service(tmp_path, "install", "--json"))
    assert document["dry_run"] is False
    assert {"verb": "write", "what": f"/{UNIT}", "why": "new"} in document["steps"]


@pytest.mark.skipif(os.geteuid() != 0, reason="an ordinary user has no folder of root's")
def test_an_ordinary_user_is_told_to_use_sudo(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    command = ["unshare", "--user", "--map-user=1000", sys.executable, "-m", "ecatd.cli"]
    command += ["service", "install", "--root", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 6, done
    assert "sudo" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_masked_unit_and_links_out_of_the_image_are_left_alone(tmp_path: Path) -> None:
    root, outside = tmp_path / "root", tmp_path / "outside"
    outside.mkdir()
    target = outside / "target"
    target.write_text("of somebody else\n")
    unit = root / UNIT
    unit.parent.mkdir(parents=True)
    unit.symlink_to(target)
    told = service(root, "install", "--interface", "eth7")
    assert re.search(rf"^keep +/{UNIT} ", told, re.MULTILINE)
    assert target.read_text() == "of somebody else\n"
    service(root, "uninstall", "--purge")
    assert unit.is_symlink()
    assert target.read_text() == "of somebody else\n"
    (root / "etc/sysusers.d").rmdir()
    (root / "etc/sysusers.d").symlink_to(outside)
    assert "leads out of" in service(root, "install", status=7)
    assert [path.name for path in outside.iterdir()] == ["target"]


def test_purging_a_linked_folder_removes_the_link(tmp_path: Path) -> None:
    root, outside = tmp_path / "root", tmp_path / "outside"
    outside.mkdir()
    (outside / "mine.toml").write_text("")
    root.mkdir()
    service(root, "install")
    (root / "etc/ecatd").symlink_to(outside)
    service(root, "uninstall", "--purge")
    assert not (root / "etc/ecatd").is_symlink()
    assert (outside / "mine.toml").exists()


def test_what_was_changed_since_stays(tmp_path: Path) -> None:
    service(tmp_path, "install", "--interface", "eth7")
    edited = tmp_path / UNIT
    edited.write_text(edited.read_text() + "# mine\n")
    link = tmp_path / "usr/local/bin/ecatctl"
    link.unlink()
    link.symlink_to("/opt/mine/ecatctl")
    script = tmp_path / "usr/local/bin/ecatsim"
    script.unlink()
    script.write_text("mine")
    (tmp_path / "usr/local/share/man/man1/ecatd.1").unlink()
    told = service(tmp_path, "upgrade")
    assert (str(link.readlink()), script.read_text()) == ("/opt/mine/ecatctl", "mine")
    edited.write_text("# mine again\n")
    told = service(tmp_path, "uninstall")
    assert "changed since it was installed" in told
    assert edited.read_text() == "# mine again\n"
    left = {path for path in tree(tmp_path) if "before-ecatd" not in path}
    assert left == {UNIT, CONFIGURATION, "usr/local/bin/ecatctl", "usr/local/bin/ecatsim"}


def test_no_copy_is_written_over_another(tmp_path: Path) -> None:
    unit = tmp_path / UNIT
    unit.parent.mkdir(parents=True)
    for text in ("first\n", "second\n"):
        unit.write_text(text)
        service(tmp_path, "install")
    copies = sorted(unit.parent.glob("*.before-ecatd*"))
    assert [copy.read_text() for copy in copies] == ["first\n", "second\n"]


def test_an_interrupted_installation_can_be_removed(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ecatd.cli", "service", "install", "--root", str(tmp_path)]
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as nobody:
        subprocess.run(command, stdout=nobody, check=False)
    assert (tmp_path / "usr/local/bin/ecatd").is_symlink()  # it was finished
    for path in list(tree(tmp_path))[::2]:
        if path != LIST:
            (tmp_path / path).unlink()
    service(tmp_path, "uninstall")
    assert tree(tmp_path) == {}


def test_folders_can_be_read_whatever_the_umask_is(tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    command = [sys.executable, "-m", "ecatd.cli", "service", "install", "--interface", "eth7"]
    subprocess.run([*command, "--root", str(root)], umask=0o077, check=True, capture_output=True)
    folders = [path for path in root.rglob("*") if path.is_dir() and not path.is_symlink()]
    assert {path.stat().st_mode & 0o777 for path in folders} == {0o755}


@pytest.mark.parametrize(
    "text",
    [
        '{"files": {"etc/x": "y"}}',
        '{"files": {"/../x": "y"}}',
        '{"files": {"/\\ud800": "y"}}',
        "[" * 100_000,
    ],
)
def test_a_damaged_list_is_refused(tmp_path: Path, text: str) -> None:
    service(tmp_path, "install")
    (tmp_path / LIST).write_text(text)
    assert "installed.json is damaged" in service(tmp_path, "uninstall", status=7)


def test_odd_arguments(tmp_path: Path) -> None:
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    for root in (str(loop), ""):
        done = run_module("ecatd.cli", "service", "install", "--root", root)
        assert (done.returncode, "Traceback" in done.stderr) == (2, False), done
    for name in ("a\x01b", "é" * 15, ".", "..", "eth0/x"):
        assert "network interface" in service(tmp_path, "install", "--interface", name, status=2)
    command = f"{sys.executable} -m ecatd.cli service install --root {tmp_path} >&-"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
