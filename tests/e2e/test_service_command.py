"""`ecatctl service` in the file system of an image: what it writes, keeps and removes."""

import json
import os
import re
import shlex
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from conftest import PYTHON, names, naming, run_module
from ecatd.admin.installation.places import Place
from ecatd.admin.installation.service import check_readable, install
from ecatd.base.errors import UsageError

POSTRM = Path(__file__).parents[2] / "packaging/debian/ecatd.postrm"
PROGRAMS = Path(sysconfig.get_path("scripts"))
UNIT = "usr/local/lib/systemd/system/ecatd.service"
UNIT_OF_BUS = "usr/local/lib/systemd/system/ecatd@.service"
SETTINGS = "etc/systemd/system"
RULES = "etc/udev/rules.d/85-ecatd.rules"
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
        "etc/tmpfiles.d/ecatd.conf",
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
        (command,) = re.findall(r"^ExecStart=(.+)", found[unit][0].decode(), re.MULTILINE)
        assert shlex.split(command)[0] == str(PROGRAMS / "ecatd")
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
    put(tmp_path, "etc/udev/rules.d/70-ecatd.rules.before-ecatd", "mine\n")
    own = tmp_path / UNIT_OF_BUS
    own.write_text("# written by the administrator\n")
    told = service(tmp_path, "upgrade")
    assert b"Description=older" not in (tmp_path / UNIT).read_bytes()
    assert (tmp_path / "etc/udev/rules.d/70-ecatd.rules").read_text() == "mine\n"
    assert not (tmp_path / f"{UNIT}.ecatd-old").exists()
    saved = tmp_path / f"{UNIT_OF_BUS}.ecatd-old"
    assert saved.read_text() == "# written by the administrator\n"
    assert "ExecStart=" in own.read_text()
    assert f"/{UNIT_OF_BUS}.ecatd-old" in told
    assert configuration.read_text() == 'interface = "eth9"\n'


def folders(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*") if path.is_dir()}


def put(root: Path, path: str, text: str = "") -> Path:
    """A file of the administrator, or a link."""
    file = root / path
    file.parent.mkdir(parents=True, exist_ok=True)
    if text.startswith("/"):
        file.symlink_to(text)
    else:
        file.write_text(text)
    return file


def enable(root: Path, unit: str) -> None:
    put(root, f"{SETTINGS}/multi-user.target.wants/{unit}", f"/{UNIT_OF_BUS}")


OF_THE_ADMINISTRATOR = {
    "etc/ecatd/notes.txt",
    "etc/ecatd/profiles/drive.toml",
    f"{SETTINGS}/ecatd@press.service.d/override.conf",
    f"{SETTINGS}/ecatd-gateway.service",
    "var/lib/ecatd/ecat0/fault.pcapng",
    "run/ecatd-doctor.json",
    f"{UNIT}.ecatd-old",
}


def with_files_of_the_administrator(root: Path) -> None:
    put(root, f"{SETTINGS}/ecatd-exporter.service", "of another program\n")
    before = put(root, RULES, "mine\n")
    before.chmod(0o640)
    service(root, "install", "--interface", "eth7")
    (root / UNIT).write_text("# changed\n")
    service(root, "upgrade")
    enable(root, "ecatd@press.service")
    for path in OF_THE_ADMINISTRATOR - {f"{UNIT}.ecatd-old"}:
        put(root, path, "/dev/null" if path.endswith("gateway.service") else "mine\n")


def test_purge_names_what_it_removes_and_leaves_what_was_there_before(tmp_path: Path) -> None:
    with_files_of_the_administrator(tmp_path)
    before = tree(tmp_path)
    would = service(tmp_path, "uninstall", "--purge", "--dry-run")
    assert tree(tmp_path) == before
    told = service(tmp_path, "uninstall", "--purge")
    for path in before.keys() - tree(tmp_path).keys() - {f"{RULES}.before-ecatd"}:
        assert re.search(rf"^would remove +/{re.escape(path)}( |$)", would, re.MULTILINE), path
        assert re.search(rf"^remove +/{re.escape(path)}( |$)", told, re.MULTILINE), path
    assert set(tree(tmp_path)) == {RULES, f"{SETTINGS}/ecatd-exporter.service"}
    rules = tmp_path / RULES
    assert (rules.read_text(), rules.stat().st_mode & 0o777) == ("mine\n", 0o640)
    above = {str(path) for path in Path(RULES).parents} | {
        str(path) for path in Path(SETTINGS).parents
    }
    assert folders(tmp_path) == (above | {SETTINGS}) - {"."} | {
        f"{SETTINGS}/multi-user.target.wants",
        "run",
        "var",
        "var/lib",
    }


def test_without_purge_files_of_the_administrator_stay_and_are_named(tmp_path: Path) -> None:
    with_files_of_the_administrator(tmp_path)
    told = service(tmp_path, "uninstall")
    kept = {*OF_THE_ADMINISTRATOR, CONFIGURATION, RULES, f"{SETTINGS}/ecatd-exporter.service"}
    assert set(tree(tmp_path)) == kept
    assert (tmp_path / RULES).read_text() == "mine\n"
    keeping = "\n".join(line for line in told.splitlines() if line.startswith("keep "))
    for path in OF_THE_ADMINISTRATOR:
        assert Path(path).name in keeping
    assert f"{PROGRAMS}/ecatctl service uninstall --purge --root {tmp_path}`" in told
    service(tmp_path, "uninstall", "--purge")
    assert set(tree(tmp_path)) == {RULES, f"{SETTINGS}/ecatd-exporter.service"}


def test_a_purge_of_the_package_leaves_only_what_is_not_of_ecatd() -> None:
    """The script of the Debian package, in a file system of its own."""
    script = """
        for folder in etc run var dev/shm; do mount -t tmpfs none /$folder; done
        mkdir -p /dev/shm/ecat /run/ecatd/ecat0 /etc/ecatd /var/lib/ecatd /var/log/ecatd
        touch /run/ecatd-doctor.json
        mkdir -p /etc/systemd/system; cd /etc/systemd/system
        mkdir multi-user.target.wants cell.target.requires ecatd.service.d
        ln -s /lib/systemd/system/ecatd@.service multi-user.target.wants/ecatd@press.service
        ln -s /usr/lib/systemd/system/ecatd@.service cell.target.requires/ecatd@saw.service
        ln -s /usr/local/lib/systemd/system/ecatd@.service multi-user.target.wants/ecatd@own.service
        ln -s /lib/systemd/system/ssh.service multi-user.target.wants/ssh.service
        touch ecatd.service.d/override.conf
        sh -c "$0" postrm remove
        test -L multi-user.target.wants/ecatd@press.service
        sh -c "$0" postrm purge
        find /etc /run /var ! -type d
        find /dev/shm -mindepth 1
    """
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    command = ["unshare", *user, "--mount", "sh", "-ec", script, POSTRM.read_text()]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert set(done.stdout.split()) == {
        f"/{SETTINGS}/{path}"
        for path in (
            "multi-user.target.wants/ecatd@own.service",
            "multi-user.target.wants/ssh.service",
            "ecatd.service.d/override.conf",
        )
    }


def test_a_removal_names_the_buses_that_no_longer_start_with_the_machine(tmp_path: Path) -> None:
    service(tmp_path, "install", "--interface", "eth7")
    for bus in ("press", "saw"):
        put(tmp_path, f"etc/ecatd/{bus}.toml", 'interface = "eth8"\n')
    enable(tmp_path, "ecatd.service")
    enable(tmp_path, "ecatd@press.service")
    told = service(tmp_path, "uninstall")
    assert "systemctl enable ecatd@press.service" in told
    assert "systemctl enable ecatd.service" in told
    assert "saw" not in told.partition("next:")[2]
    assert not list((tmp_path / SETTINGS).rglob("ecatd*"))
    enable(tmp_path, "ecatd.service")
    following = service(tmp_path, "install").partition("next:")[2]
    for name in ("ecatd@press.service", "ecatd@saw.service"):
        assert f"enable {name}" in following
    assert "enable ecatd.service" not in following


def test_a_masked_unit_stays_masked(tmp_path: Path) -> None:
    mask = put(tmp_path, f"{SETTINGS}/ecatd.service", "/dev/null")
    told = service(tmp_path, "install", "--interface", "eth7")
    assert "systemctl unmask ecatd.service" in told
    assert mask.is_symlink()
    assert (tmp_path / UNIT).is_file()


def test_what_to_do_next_is_about_the_bus(tmp_path: Path) -> None:
    following = service(tmp_path, "install", "--bus", "press").partition("next:")[2]
    assert "ecatctl --bus press service install --interface IF" in following
    assert "systemctl start ecatd@press.service" in following
    assert "ecatctl --bus press check" in following
    assert not re.search(r"`ecatctl (?!--bus press)", following)


def test_an_upgrade_says_which_buses_need_a_restart(tmp_path: Path) -> None:
    service(tmp_path, "install", "--interface", "eth7")
    names(service(tmp_path, "upgrade"), "up to date")
    socket = put(tmp_path, "run/ecatd/press/control")
    names(service(tmp_path, "upgrade"), "up to date")
    (tmp_path / UNIT_OF_BUS).write_text("# older\n")
    os.utime(socket, (0, 0))
    told = service(tmp_path, "upgrade")
    assert "systemctl restart ecatd@press.service" in told
    assert "up to date\n" not in told.splitlines()[-1]


@pytest.mark.parametrize("folder", ["/root", "/home/me", "/tmp"])
def test_a_program_that_the_service_cannot_see_is_refused(folder: str) -> None:
    place = Place(Path("/"), Path(folder) / "venv/bin")
    with pytest.raises(UsageError, match=naming(f"{folder}/venv", "-m venv /opt/ecatd")):
        next(install(place, "ecat0", None))


def test_a_program_that_only_root_can_read_is_refused(tmp_path: Path) -> None:
    check_readable(Path("/etc/passwd"))
    program = put(tmp_path, "ecatd")
    tmp_path.chmod(0o700)
    with pytest.raises(UsageError, match=naming("0700", "chmod")):
        check_readable(program)


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
    assert "is not a folder" in service(tmp_path / "absent", "install", status=2)
    assert "network interface" in service(tmp_path, "install", "--interface", 'a"b', status=2)
    assert "bus name" in service(tmp_path, "install", "--bus", "a/b", status=2)
    assert "is for install" in service(tmp_path, "upgrade", "--interface", "eth7", status=2)
    assert "is for uninstall" in service(tmp_path, "install", "--purge", status=2)
    assert tree(tmp_path) == {}
    service(tmp_path, "install")
    (tmp_path / LIST).write_text("[]")
    assert "installed.json is damaged" in service(tmp_path, "uninstall", status=7)


@pytest.mark.parametrize(
    "programs", ['/opt/1" pipe/bin', "/opt/it's/bin", "/opt/a\\b", "/opt/a\nb"]
)
def test_programs_that_a_unit_cannot_name_are_refused(tmp_path: Path, programs: str) -> None:
    with pytest.raises(UsageError, match=naming("/opt/", "unit", "/opt/ecatd")):
        next(install(Place(tmp_path, Path(programs)), "ecat0", None))


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
    names(told, "changed since")
    assert edited.read_text() == "# mine again\n"
    left = {path for path in tree(tmp_path) if "ecatd-old" not in path}
    assert left == {UNIT, CONFIGURATION, "usr/local/bin/ecatctl", "usr/local/bin/ecatsim"}


def test_no_copy_is_written_over_another(tmp_path: Path) -> None:
    unit = tmp_path / UNIT
    unit.parent.mkdir(parents=True)
    for text in ("first\n", "second\n", "third\n"):
        unit.write_text(text)
        service(tmp_path, "install")
    copies = sorted(unit.parent.glob("ecatd.service.*"))
    assert [(copy.name, copy.read_text()) for copy in copies] == [
        ("ecatd.service.before-ecatd", "first\n"),
        ("ecatd.service.ecatd-old", "second\n"),
        ("ecatd.service.ecatd-old-2", "third\n"),
    ]


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
    command = f"{PYTHON} -m ecatd.cli service install --root {tmp_path} >&-"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
