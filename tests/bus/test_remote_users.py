"""Users of other machines: certificates, what each may do, and what nobody may."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh
from following import following

from conftest import (
    PATIENCE,
    Daemon,
    free_port,
    names,
    naming,
    one_line_error,
    run_module,
    stop_process,
    wait_for,
)
from ecatd.base.errors import (
    NoAnswerError,
    NotPermittedError,
    StateError,
    UnreachableError,
    UsageError,
)
from ecatd.client.hold import Hold
from ecatd.client.identity import read_identity
from ecatd.client.remote import Remote
from ecatd.operations.bus import ReadEvents, ReadInfo, ReadStates, SetState
from ecatd.operations.encoding import pack, unpack
from ecatd.operations.log import SetLogLevel
from ecatd.operations.outputs import HoldOutputs, ReadOutputs, ReleaseOutputs
from ecatd.operations.registers import WriteRegister
from ecatd.operations.zenoh_keys import bus_key, session_config

pytestmark = [
    pytest.mark.bus,
    pytest.mark.unprivileged,
    pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates"),
]

CONFIG = """\
[gateway]
listen = ["tls/127.0.0.1:{port}"]
certificate = "{folder}/daemon.pem"
key = "{folder}/daemon.key"
users_ca = "{folder}/authority.pem"
[[gateway.user]]
name = "anna"
write = ["sdo", "state", "log", "outputs"]
slaves = [0, "EK1100"]
[[gateway.user]]
name = "bob"
[[gateway.user]]
name = "7.eve@press"
[[gateway.user]]
name = "dora"
write = ["log", "frames"]
changes_max = 2
[[gateway.user]]
name = "fred"
write = ["incident"]
[flight_recorder]
folder = "{folder}/incidents"
before_s = 0.5
after_s = 0.1
faults = false
"""


def remote_command(*arguments: str) -> subprocess.CompletedProcess[str]:
    return run_module("ecatd.cli", "remote", *arguments, env={**os.environ})


class Site:
    """A daemon, and the identities of its users."""

    def __init__(self, folder: Path, start: Callable[..., Daemon]) -> None:
        self.folder = folder / "tls"
        self.port = free_port()
        made = remote_command("init", "--dir", str(self.folder), "--host", "machine.example")
        assert made.returncode == 0, made.stderr
        names(made.stdout, "users_ca", f"{self.folder}/daemon.pem", "machine.example")
        for user in ("anna", "bob", "carl", "dora", "fred", "7.eve@press"):
            made = remote_command("user", user, "--dir", str(self.folder), "-o", str(self[user]))
            assert made.returncode == 0, made.stderr
            names(made.stdout, "[[gateway.user]]", f'name = "{user}"')
        self.daemon = start("troll", config=CONFIG.format(port=self.port, folder=self.folder))

    def __getitem__(self, user: str) -> Path:
        return self.folder / f"{user}.pem"

    @property
    def endpoint(self) -> str:
        return f"tls/127.0.0.1:{self.port}"

    def as_user(self, user: str) -> Remote:
        return Remote(self.daemon.bus, self.endpoint, 10.0, self[user])

    def session(self, user: str) -> zenoh.Session:
        settings = {"connect/endpoints": [self.endpoint], **read_identity(self[user]).settings}
        return zenoh.open(session_config("client", settings))

    def ctl(self, user: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        where = ("--bus", self.daemon.bus, "--connect", self.endpoint)
        return run_module("ecatd.cli", *where, "--identity", str(self[user]), *arguments)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, start_shared: Callable[..., Daemon]) -> Site:
    return Site(tmp_path_factory.mktemp("site"), start_shared)


def test_r36_a_user_reads_and_changes_what_the_configuration_says(site: Site) -> None:
    with site.as_user("anna") as anna:
        with site.as_user("7.eve@press") as eve:  # each letter stands in keys as it is
            assert eve.rights()["user"] == "7.eve@press"
        assert anna.rights() == {
            "user": "anna",
            "read": True,
            "write": ["sdo", "state", "log", "outputs"],
            "slaves": [0, "EK1100"],
            "schema": 1,
        }
        assert len(anna.request(ReadStates())["slaves"]) == 8
        before = anna.sdo_read(0, 0x6060).data
        anna.sdo_write(0, 0x6060, 0, b"\x09")
        anna.sdo_write(0, 0x6060, 0, before)
        names(site.daemon.log, "0x6060:00", "user 'anna'", "pid")
        anna.request(SetLogLevel("debug", "dc"))
        anna.request(SetLogLevel("info", "dc"))
        for change in (
            lambda: anna.sdo_write(4, 0x8000, 0x16, b"\0"),
            lambda: anna.request(SetState("SAFEOP", 4)),
            lambda: anna.request(SetState("SAFEOP")),
        ):
            with pytest.raises(NotPermittedError, match=naming("'anna'", "EK1100", "slaves")):
                change()
        with pytest.raises(NotPermittedError, match=naming("'anna'", "'register'", "sdo")):
            anna.request(WriteRegister(0, 0x0410, b"\0"))
        # Outputs of his slaves, by hand.
        drive, lamp = "0/0x60FF:00", "3/0x7000:01"
        with Hold(anna, {drive: "7"}):
            found = anna.request(ReadOutputs())
            assert [row["user"] for row in found["owners"] if row["by_hand"]] == ["anna"]
        names(site.daemon.log, "0x60FF:00", "changed to 7 by user 'anna'", "by hand")
        with pytest.raises(NotPermittedError, match=naming("'anna'", "EK1100", "slaves")):
            anna.request(HoldOutputs("page", {drive: "7", lamp: "1"}, begin=True))
        with site.as_user("7.eve@press") as eve:
            for request in (HoldOutputs("page", {lamp: "1"}, begin=True), ReleaseOutputs(None)):
                with pytest.raises(NotPermittedError, match=naming("'7.eve@press'", "'outputs'")):
                    eve.request(request)
        with pytest.raises(StateError, match="slave 99"):
            anna.sdo_write(99, 0x6060, 0, b"\x09")
    rows = site.daemon.slave_rows
    wait_for(lambda: {row["text"] for row in rows("state")} == {"OP"}, site.daemon)


def test_a_user_without_rights_only_reads(site: Site) -> None:
    shown = site.ctl("bob", "remote", "test")
    assert shown.returncode == 0, shown.stderr
    names(shown.stdout, "'bob'", "reads", "nothing")
    assert site.ctl("bob", "slaves").returncode == 0
    refused = site.ctl("bob", "sdo-write", "0", "0x6060", "0", "9")
    assert refused.returncode == 6
    names(one_line_error(refused.stderr, "ecatctl"), "'bob'", "'sdo'", "only read")
    with site.as_user("bob") as bob, site.as_user("anna") as anna:
        bus = bob.describe()
        names(bob.why_not("sdo", bus.slaves[0]), "'bob'", "'sdo'", "gateway.user.write")
        assert [anna.why_not("sdo", bus.slaves[n]) for n in (0, 1)] == ["", ""]
        names(anna.why_not("sdo", bus.slaves[2]), "'anna'", "0, EK1100", "gateway.user.slaves")
    wait_for(lambda: "refused: user 'bob'" in site.daemon.log, site.daemon)


def test_only_a_user_with_the_right_captures_frames(site: Site, tmp_path: Path) -> None:
    """In the frames are files of slaves, and their passwords."""
    file = tmp_path / "last.pcapng"
    names(site.ctl("dora", "remote", "test").stdout, "'dora'", "but files", "frames", "log")
    captured = site.ctl("dora", "capture", "-o", str(file))
    assert captured.returncode == 0, captured.stderr
    assert file.stat().st_size > 1000
    refused = site.ctl("anna", "capture", "-o", str(tmp_path / "none"))
    assert refused.returncode == 6
    names(one_line_error(refused.stderr, "ecatctl"), "'anna'", "'frames'", "gateway.user.write")
    payload = pack({"id": "0123"})
    with site.session("anna") as anna:
        for ring in ("cycle", "control"):
            (old,) = anna.get(bus_key(site.daemon.bus, "ro", "frames", ring), timeout=10.0)
            names(unpack(bytes(old.err.payload))["error"]["message"], f"ro/frames/{ring}")
            key = bus_key(site.daemon.bus, "rw", "frames", ring)
            assert [*anna.get(key, payload=payload, timeout=1.0)] == []


def test_the_list_of_incidents_needs_no_right_but_their_content_does(
    site: Site, tmp_path: Path
) -> None:
    """Who may record and delete them need not see the frames in them."""
    pytest.importorskip("mcap")
    made = site.ctl("fred", "--json", "incident", "record", "by fred")
    assert made.returncode == 0, made.stderr
    name = json.loads(made.stdout)["name"]
    names(site.ctl("bob", "incident", "list").stdout, name, "by fred")
    for user in ("bob", "fred"):
        refused = site.ctl(user, "incident", "show", name)
        assert refused.returncode == 6
        names(one_line_error(refused.stderr, "ecatctl"), f"'{user}'", "'frames'")
    names(site.ctl("dora", "incident", "show", name).stdout, "Bus", "by fred")
    exported = site.ctl("dora", "incident", "export", name, "-o", str(tmp_path / "it.mcap"))
    assert exported.returncode == 0, exported.stderr
    for user in ("bob", "dora"):
        for action in ("record", "delete"):
            refused = site.ctl(user, "incident", action, name)
            assert refused.returncode == 6
            names(one_line_error(refused.stderr, "ecatctl"), f"'{user}'", "'incident'")
    assert site.ctl("fred", "incident", "delete", name).returncode == 0
    assert name not in site.ctl("bob", "incident", "list").stdout


def test_r36_who_is_not_let_in(site: Site, tmp_path: Path) -> None:
    # A certificate of the right authority, of a user whom the configuration does not know.
    with site.as_user("carl") as carl:
        with pytest.raises(NotPermittedError, match=naming("'carl'", "[[gateway.user]]")):
            carl.request(ReadInfo())
        with pytest.raises(NotPermittedError, match="carl"):
            carl.rights()
    # That of another user, in whose file somebody has written a name with more rights.
    renamed = tmp_path / "renamed.pem"
    renamed.write_text(site["bob"].read_text().replace("ecatd user: bob", "ecatd user: anna"))
    with Remote(site.daemon.bus, site.endpoint, PATIENCE, renamed) as bob:
        assert bob.request(ReadInfo())["host"]
        with pytest.raises(NotPermittedError, match=naming("'anna'", str(renamed), "another name")):
            bob.sdo_write(0, 0x6060, 0, b"\x08")
    # One of another authority, with the same name.
    other = tmp_path / "other"
    assert remote_command("init", "--dir", str(other)).returncode == 0
    forged = tmp_path / "anna.pem"
    assert remote_command("user", "anna", "--dir", str(other), "-o", str(forged)).returncode == 0
    with pytest.raises(NotPermittedError, match=naming("certificate of the daemon", str(forged))):
        Remote(site.daemon.bus, site.endpoint, PATIENCE, forged)
    mixed = tmp_path / "mixed.pem"  # it trusts the daemon, which does not trust it
    authority = (site.folder / "authority.pem").read_text()
    head = forged.read_text().split("-----END PRIVATE KEY-----\n")[0]
    mixed.write_text(f"{head}-----END PRIVATE KEY-----\n{authority}")
    with pytest.raises(NotPermittedError, match=naming("'anna'", "authority", "gateway.users_ca")):
        Remote(site.daemon.bus, site.endpoint, PATIENCE, mixed)
    # None at all.
    with pytest.raises(NotPermittedError, match="ecatctl remote user"):
        Remote(site.daemon.bus, site.endpoint, PATIENCE)
    assert site.as_user("anna").request(ReadInfo())["host"]


@pytest.mark.long
def test_who_may_not_and_who_gets_no_answer_are_told_apart(
    start_daemon: Callable[..., Daemon], site: Site
) -> None:
    port = free_port()
    daemon = start_daemon("troll", config=CONFIG.format(port=port, folder=site.folder))
    server = daemon.child_pid("ecatd.server")
    users = {
        name: Remote(daemon.bus, f"tls/127.0.0.1:{port}", 2.0, site[name])
        for name in ("anna", "carl")
    }
    os.kill(server, signal.SIGSTOP)
    try:
        with pytest.raises(NoAnswerError, match=naming("2 s", "bus server", "change")):
            users["anna"].sdo_write(0, 0x6060, 0, b"\x09")
        with pytest.raises(NoAnswerError, match=naming("2 s", "bus server")):
            users["anna"].request(ReadStates())["slaves"]
        with pytest.raises(NotPermittedError, match=naming("'carl'", "[[gateway.user]]")):
            users["carl"].request(SetState("OP"))["slaves"]
    finally:
        daemon.kill_all()
    for user in users.values():
        for operation in (ReadInfo(), SetState("OP")):
            with pytest.raises(UnreachableError, match=naming(f"127.0.0.1:{port}", "ended")):
                user.request(operation)
        user.close()


def expired_identity(authority: Path, folder: Path) -> Path:
    """An identity of anna, whose certificate has expired."""
    key, request, certificate = (folder / name for name in ("k.pem", "r.pem", "c.pem"))
    new = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")
    openssl("req", *new, "-keyout", key, "-out", request, "-subj", "/CN=anna")
    (folder / "index").write_text("")
    (folder / "serial").write_text("1234\n")
    (folder / "ca.cnf").write_text(
        f"[ca]\ndefault_ca=c\n[c]\ndatabase={folder}/index\nserial={folder}/serial\n"
        f"new_certs_dir={folder}\npolicy=p\ndefault_md=sha256\n[p]\ncommonName=supplied\n"
    )
    openssl(
        *("ca", "-batch", "-config", folder / "ca.cnf", "-in", request, "-out", certificate),
        *("-cert", authority / "authority.pem", "-keyfile", authority / "authority.key"),
        *("-startdate", "200101000000Z", "-enddate", "200201000000Z", "-notext"),
    )
    parts = (certificate, key, authority / "authority.pem")
    old = folder / "old.pem"
    old.write_text("ecatd user: anna\n" + "".join(part.read_text() for part in parts))
    return old


def test_r36_an_expired_certificate_is_not_let_in(site: Site, tmp_path: Path) -> None:
    old = expired_identity(site.folder, tmp_path)
    with pytest.raises(NotPermittedError, match=naming("'anna'", "expired", str(old))):
        Remote(site.daemon.bus, site.endpoint, PATIENCE, old)
    shown = remote_command("show", str(old))
    assert shown.returncode == 7
    names(shown.stdout, "'anna'", "2020")
    names(one_line_error(shown.stderr, "ecatctl"), str(old), "expired")


def test_what_is_wrong_with_an_identity_is_shown(site: Site, tmp_path: Path) -> None:
    anna, bob = (site[name].read_text() for name in ("anna", "bob"))
    ends = "-----END CERTIFICATE-----\n"
    file = tmp_path / "mixed.pem"
    file.write_text(anna.split(ends)[0] + ends + ends.join(bob.split(ends)[1:]))
    shown = remote_command("show", str(file))
    assert shown.returncode == 7
    names(shown.stderr, "does not belong")
    file.write_text(anna.replace("user: anna", "user: eve"))
    names(remote_command("show", str(file)).stderr, "'anna'", "'eve'")
    file.write_text(anna.replace("MII", "XXX"))
    broken = remote_command("show", str(file))
    assert broken.returncode == 2
    names(one_line_error(broken.stderr, "ecatctl"), str(file))
    fine = remote_command("show", str(site["anna"]))
    assert fine.returncode == 0
    names(fine.stdout, "'anna'", "authority")


def test_a_client_cannot_write_another_name_into_the_log(site: Site) -> None:
    forged = "x'; slave 0, 0x6060:00: changed by user 'bob'"
    payload = pack({"id": "forged", "data": b"\x08", "by": forged})
    key = bus_key(site.daemon.bus, "as", "anna", "rw", "sdo", "0", "0x6060", "00")
    with site.session("anna") as anna:
        (answer,) = anna.get(key, payload=payload, timeout=10.0)
        assert answer.ok is not None
    (line,) = (line for line in site.daemon.log.splitlines() if "slave 0, 0x6060:00" in line)
    assert "user 'anna' [x slave 0, 0x6060:00: changed by user bob]" in line


def openssl(*arguments: str | Path) -> None:
    subprocess.run(["openssl", *arguments], check=True, capture_output=True)


@pytest.mark.long
def test_a_user_is_taken_out_while_the_bus_runs(
    start_daemon: Callable[..., Daemon], site: Site
) -> None:
    port = free_port()
    config = CONFIG.format(port=port, folder=site.folder)
    daemon = start_daemon("troll", config=config)
    endpoint = f"tls/127.0.0.1:{port}"
    with Remote(daemon.bus, endpoint, 10.0, site["anna"]) as anna:
        anna.sdo_write(0, 0x6060, 0, anna.sdo_read(0, 0x6060).data)
    daemon.config_file.write_text(
        config.split('[[gateway.user]]\nname = "anna"')[0] + ("[[gateway.user]]\nname = 'bob'\n")
    )
    os.kill(daemon.process.pid, 1)  # SIGHUP: reload

    def rights(user: str) -> dict[str, object] | None:
        try:
            with Remote(daemon.bus, endpoint, 3.0, site[user]) as remote:
                return remote.rights()
        except (NotPermittedError, UnreachableError, NoAnswerError):
            return None  # the gateway that knows the users is starting

    wait_for(lambda: (rights("bob") or {}).get("write") == [], daemon)
    wait_for(lambda: rights("bob") is not None and rights("anna") is None, daemon)


@pytest.mark.long
def test_what_a_user_follows_goes_on_after_a_restart_of_the_daemon(
    start_daemon: Callable[..., Daemon], site: Site
) -> None:
    """No event is lost, even if the new daemon has had as many as the old one before."""
    config = CONFIG.format(port=(port := free_port()), folder=site.folder)
    daemon = start_daemon("troll", config=config)
    bus, endpoint = daemon.bus, f"tls/127.0.0.1:{port}"
    where = ("--bus", bus, "--connect", endpoint, "--identity", str(site["anna"]))
    with (
        following(*where, "events", "-f") as events,
        following(*where, "watch", "2/*", "--hz", "10") as watch,
    ):
        daemon.ctl("log-level", "dc", "debug")
        wait_for(lambda: "log_levels" in [item["event"] for item in events.documents], daemon)
        wait_for(lambda: bool(watch.documents), daemon)
        daemon.kill_all()
        while not all("waiting for it" in item.said and item.documents for item in (events, watch)):
            time.sleep(0.02)
        before, rows = events.documents, len(watch.documents)
        stop_process(events.process.pid)
        again = start_daemon("troll", "--bus", bus, config=config)
        with Remote(bus, endpoint, 60.0, site["anna"]) as anna:
            for level in ("debug", "info"):
                anna.request(SetLogLevel(level, "dc"))
            while anna.request(ReadEvents())["next"] <= before[-1]["sequence"] + 1:
                anna.request(SetLogLevel("debug", "dc"))
                anna.request(SetLogLevel("info", "dc"))
            events.process.send_signal(signal.SIGCONT)
            new = anna.request(ReadEvents())
            assert new["instance"] != before[-1]["instance"]
            expected = [(new["instance"], number) for number in range(1, new["next"])]

            def shown() -> list[tuple[int, int]]:
                later = events.documents[len(before) :]
                return [(item["instance"], item["sequence"]) for item in later]

            wait_for(lambda: len(shown()) >= len(expected), again)
            assert shown()[: len(expected)] == expected
        names(events.said, "started again", f"'{bus}'")
        wait_for(lambda: len(watch.documents) > rows, again)


@pytest.mark.long
def test_certificates_that_cannot_be_used_cost_only_the_encrypted_addresses(
    start_daemon: Callable[..., Daemon], site: Site, tmp_path: Path
) -> None:
    config = CONFIG.format(port=free_port(), folder=site.folder)
    wrong = tmp_path / "wrong.pem"
    wrong.write_text("nothing")
    for old, new, tokens in (
        ("daemon.pem", "nowhere.pem", ("gateway.certificate", "remote init")),
        ("daemon.key", "authority.key", ("gateway.key", "together")),
        (f"{site.folder}/daemon.pem", str(wrong), ("gateway.certificate", "PEM")),
        (f"{site.folder}/authority.pem", str(wrong), ("gateway.users_ca", "PEM")),
    ):
        daemon = start_daemon("troll", config=config.replace(old, new))
        assert len(daemon.slave_rows()) == 8
        names(daemon.log, "encrypted addresses", *tokens)
        assert daemon.stop() == 0


@pytest.mark.long
def test_who_is_silent_is_told_from_who_is_absent(
    start_daemon: Callable[..., Daemon], site: Site
) -> None:
    ports = free_port(), free_port()
    config = CONFIG.format(port=ports[0], folder=site.folder)
    plain = f'"tls/127.0.0.1:{ports[0]}", "tcp/127.0.0.1:{ports[1]}"'
    daemon = start_daemon("troll", config=re.sub(r"(listen = \[).*(\])", rf"\1{plain}\2", config))
    endpoints = f"tls/127.0.0.1:{ports[0]}", f"tcp/127.0.0.1:{ports[1]}"
    stop_process(daemon.process.pid)  # it would start another gateway
    stop_process(daemon.child_pid("ecatd.gateway"))
    for endpoint in endpoints:
        with pytest.raises(NoAnswerError, match=naming(endpoint, "busy or hangs")):
            Remote(daemon.bus, endpoint, 2.0, site["anna"])
    daemon.kill_all()
    for endpoint in endpoints:
        with pytest.raises(UnreachableError, match=naming(endpoint, "refused")):
            Remote(daemon.bus, endpoint, 2.0, site["anna"])


@pytest.mark.long
def test_a_renewed_certificate_is_used(
    start_daemon: Callable[..., Daemon], site: Site, tmp_path: Path
) -> None:
    folder = tmp_path / "tls"
    folder.mkdir()
    port = free_port()
    shutil.copy(site.folder / "authority.pem", folder)
    daemon = start_daemon("troll", config=CONFIG.format(port=port, folder=folder))
    names(daemon.log, "encrypted addresses", "remote init")
    for name in ("daemon.pem", "daemon.key"):
        shutil.copy(site.folder / name, folder)
    wait_for(lambda: "certificates have changed: " in daemon.log, daemon)

    def lets_in() -> bool:
        try:
            with Remote(daemon.bus, f"tls/127.0.0.1:{port}", 5.0, site["anna"]) as remote:
                return bool(remote.request(ReadInfo()))
        except (UnreachableError, NoAnswerError, NotPermittedError):
            return False

    wait_for(lets_in, daemon)
    shutil.copy(site.folder / "authority.key", folder / "daemon.key")
    wait_for(lambda: "the new ones are not used" in daemon.log, daemon)
    names(daemon.log, "gateway.key", "together")
    assert lets_in()


def test_a_port_of_another_program_is_not_a_refusal(site: Site) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]

        def talk() -> None:
            with suppress(OSError):
                while True:
                    with other.accept()[0] as connection:
                        connection.sendall(b"SSH-2.0-OpenSSH_9.2\r\n")

        threading.Thread(target=talk, daemon=True).start()
        for identity in (None, site["anna"]):
            with pytest.raises(NoAnswerError, match=naming(f"127.0.0.1:{port}", "another program")):
                Remote("ecat0", f"tls/127.0.0.1:{port}", 2.0, identity)


@pytest.mark.long
def test_slaves_of_users_that_do_not_exist_are_named(
    start_daemon: Callable[..., Daemon], site: Site
) -> None:
    port = free_port()
    config = CONFIG.format(port=port, folder=site.folder).replace('"EK1100"]', '"nix"]')
    daemon = start_daemon("troll", config=config)
    names(daemon.log, "gateway.user.slaves", "'anna'", "'nix'")
    with Remote(daemon.bus, f"tls/127.0.0.1:{port}", 10.0, site["anna"]) as anna:
        anna.sdo_write(0, 0x6060, 0, anna.sdo_read(0, 0x6060).data)
        with pytest.raises(NotPermittedError, match="'anna'"):
            anna.sdo_write(4, 0x8000, 0x16, b"\0")


@pytest.mark.parametrize(
    ("text", "tokens"),
    [
        ("", ("is not an identity", "ecatd user:")),
        ("ecatd user: anna\n", ("is not an identity",)),
        (None, ("cannot be read",)),
    ],
)
def test_wrong_identities(tmp_path: Path, text: str | None, tokens: tuple[str, ...]) -> None:
    file = tmp_path / "identity.pem"
    if text is not None:
        file.write_text(text)
    with pytest.raises(UsageError) as caught:
        read_identity(file)
    names(caught.value, str(file), *tokens)


@pytest.mark.parametrize(
    ("arguments", "status", "tokens"),
    [
        (("user",), 2, ("NAME",)),
        (("user", "a b"), 2, ("'a b'",)),
        (("user", "anna", "--dir", "/nowhere"), 7, ("/nowhere/authority.pem", "remote init")),
        (("init", "anna"), 2, ("NAME",)),
        (("init", "--host", "a b"), 2, ("'a b'",)),
        (("show", "/nowhere.pem"), 2, ("/nowhere.pem",)),
    ],
)
def test_wrong_arguments(arguments: tuple[str, ...], status: int, tokens: tuple[str, ...]) -> None:
    wrong = remote_command(*arguments)
    assert wrong.returncode == status, wrong
    names(one_line_error(wrong.stderr, "ecatctl"), *tokens)


def test_certificates_are_not_overwritten(site: Site) -> None:
    again = remote_command("init", "--dir", str(site.folder))
    assert again.returncode == 2
    names(one_line_error(again.stderr, "ecatctl"), f"{site.folder}/authority.pem", "exists")
    twice = remote_command("user", "anna", "--dir", str(site.folder), "-o", str(site["anna"]))
    assert twice.returncode == 2
    modes = {file.name: file.stat().st_mode & 0o777 for file in site.folder.iterdir()}
    assert modes["authority.key"] == modes["anna.pem"] == 0o600
    assert modes["daemon.key"] == 0o640


@pytest.mark.long
def test_a_program_that_runs_wild_is_slowed_down(site: Site) -> None:
    """Dora may ask for two changes a second: two come at once, four wait, and more are refused."""
    key = bus_key(site.daemon.bus, "as", "dora", "rw", "log", "dc")
    answers: list[zenoh.Reply] = []
    with site.session("dora") as dora:
        for number in range(20):
            payload = pack({"id": f"wild {number}", "level": "info"})
            dora.get(key, answers.append, payload=payload, timeout=60.0)
        wait_for(lambda: len(answers) == 20, site.daemon)
    refused = [unpack(bytes(reply.err.payload))["error"] for reply in answers if reply.err]
    assert len(refused) >= 10
    assert {error["name"] for error in refused} == {"busy"}
    names(refused[0]["message"], "'dora'", "2", "gateway.user.changes_max")
    assert sum(reply.ok is not None for reply in answers) >= 6


def test_r36_refused_changes_do_not_fill_the_log(site: Site) -> None:
    key = bus_key(site.daemon.bus, "as", "dora", "rw", "sdo", "0", "0x6060", "00")
    answers: list[zenoh.Reply] = []
    with site.session("dora") as dora:
        for number in range(100):
            payload = pack({"id": f"refused {number}", "data": b"\x09"})
            dora.get(key, answers.append, payload=payload, timeout=60.0)
        wait_for(lambda: len(answers) == 100, site.daemon)
    assert all(reply.err and b"permission" in bytes(reply.err.payload) for reply in answers)

    def lines() -> list[str]:
        refused = "refused: user 'dora' has no right 'sdo'"
        return [line for line in site.daemon.log.splitlines() if refused in line]

    def told() -> int:
        return len(lines()) + sum(map(int, re.findall(r"and (\d+) more", "\n".join(lines()))))

    wait_for(lambda: told() == 100, site.daemon)
    assert len(lines()) < 20
