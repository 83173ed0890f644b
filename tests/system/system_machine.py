"""A whole machine for tests: Debian 12 with a PREEMPT_RT kernel and systemd, in QEMU.

It has two network cards of a real make (Intel 82574L, driver e1000e), each on a wire of its own to
a simulated EtherCAT segment. The processor is emulated, so that it works everywhere: that is 10 to
20 times slower than the real one. So no test is about time, and buses have cycles of 10 ms.
"""

import json
import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Self

import pytest

HERE = Path(__file__).parent
MMDEBSTRAP = HERE.parents[1] / "packaging" / "mmdebstrap.sh"
PATIENCE_S = 300.0
EMULATOR_CRASHED = 75
"""Exit status of the tests if QEMU crashed: version 7.2 does so in one boot of some fifteen."""
PACKAGES = (
    *("systemd", "systemd-sysv", "dbus", "udev", "kmod", "linux-image-rt-amd64", "libpam-systemd"),
    *("iproute2", "ethtool", "procps", "python3", "strace", "network-manager", "can-utils"),
)
MACS = ("52:54:00:ec:a7:01", "52:54:00:ec:a7:02")
"""Addresses of the cards."""
_AGENT = """\
[Unit]
Description=agent of the tests
[Service]
ExecStart=/usr/bin/python3 /opt/agent.py
Restart=always
OOMScoreAdjust=-1000
[Install]
WantedBy=multi-user.target
"""


def build(folder: Path) -> None:
    """Makes the root file system, the kernel and the first disk, from Debian's packages alone."""
    work = folder.with_name(folder.name + ".new")
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    root = work / "root"
    subprocess.run(
        [
            *(str(MMDEBSTRAP), "bookworm", str(root), "--variant=minbase"),
            "--include=" + ",".join(PACKAGES),
        ],
        check=True,
    )
    shutil.copy(HERE / "agent.py", root / "opt/agent.py")
    unit = root / "etc/systemd/system/agent.service"
    unit.write_text(_AGENT)
    wants = unit.parent / "multi-user.target.wants"
    wants.mkdir(exist_ok=True)
    (wants / "agent.service").symlink_to("../agent.service")
    for name in ("vmlinuz", "initrd.img"):
        (kernel,) = (root / "boot").glob(f"{name}-*")
        shutil.copy(kernel, work / name)
    disk = work / "disk"
    with disk.open("wb") as file:
        file.truncate(3 << 30)
    subprocess.run(["mke2fs", "-q", "-t", "ext4", "-d", str(root), str(disk)], check=True)
    shutil.rmtree(root)
    work.rename(folder)


@dataclass(frozen=True, slots=True)
class Said:
    """What a command in the machine did."""

    status: int
    text: str
    seconds: float


class Machine:
    """The machine, while it runs; a context manager.

    Args:
        image: The folder that `build` has made.
        folder: For what this run needs.
        files: Given to the machine, in `/files`.
    """

    def __init__(self, image: Path, folder: Path, files: Sequence[Path]) -> None:
        self._image, self._folder, self._files = image, folder, files
        self._number = 0
        self._pending = b""
        self._monitor: Any = None
        self._monitor_socket: Any = None
        self._agent: Any = None

    def __enter__(self) -> Self:
        share = self._folder / "files.tar"
        names = [part for file in self._files for part in ("-C", str(file.parent), file.name)]
        subprocess.run(["tar", "cf", str(share), *names], check=True)
        cards = [
            part
            for number in range(2)
            for part in (
                *("-netdev", f"tap,id=wire{number},ifname=tap{number},script=no,downscript=no"),
                *("-device", f"pcie-root-port,id=slot{number},chassis={number + 1},slot={number}"),
                *(
                    "-device",
                    f"e1000e,netdev=wire{number},id=card{number},bus=slot{number},mac={MACS[number]}",
                ),
            )
        ]
        self._agent_path, monitor = self._folder / "agent", self._folder / "monitor"
        self._log = (self._folder / "console.log").open("wb")
        command = [
            *("qemu-system-x86_64", "-machine", "q35", "-accel", "tcg,thread=multi", "-cpu", "max"),
            *("-smp", "2", "-m", "1024", "-nographic", "-serial", "stdio", "-monitor", "none"),
            *("-kernel", str(self._image / "vmlinuz"), "-initrd", str(self._image / "initrd.img")),
            *("-append", "console=ttyS0 root=/dev/vda rw quiet systemd.show_status=0"),
            # Nothing is written to the image: QEMU forgets what the machine writes when it ends.
            *("-drive", f"file={self._image / 'disk'},format=raw,if=virtio,snapshot=on"),
            *("-drive", f"file={share},format=raw,if=virtio,readonly=on"),
            *("-chardev", f"socket,id=agent,path={self._agent_path},server=on,wait=off"),
            *(
                "-device",
                "virtio-serial",
                "-device",
                "virtserialport,chardev=agent,name=tests.agent",
            ),
            *("-qmp", f"unix:{monitor},server=on,wait=off"),
            *cards,
        ]
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=self._log, stderr=self._log
        )
        try:
            self._monitor_socket = _connect(monitor, self._process)
            self._monitor = self._monitor_socket.makefile("rw")
            self.monitor("qmp_capabilities")
            self._agent = _connect(self._agent_path, self._process)
            self.wait_until_it_answers()
            self("mkdir -p /files && tar xf /dev/vdb -C /files")
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._end()

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()
        for end in (self._monitor, self._monitor_socket, self._agent):
            if end is not None:
                end.close()
        self._log.close()

    def __call__(self, command: str, *, status: int | None = 0, timeout: float = 120.0) -> Said:
        """Runs a command of the shell as root, and waits for its end.

        Args:
            command: The command.
            status: The exit status that it must have; None accepts any.
            timeout: Seconds in the machine after which it is ended with status 124.
        """
        said = self._ask(command, timeout, PATIENCE_S + timeout)
        print(f"# {command}\n{said.text}[{said.status}, {said.seconds:.1f} s]", flush=True)
        assert status is None or said.status == status, f"{command}\n{said.text}[{said.status}]"
        return said

    def text(self, command: str) -> str:
        """What a command prints, without the space around it."""
        return self(command).text.strip()

    def until(self, command: str, timeout: float = 120.0) -> Said:
        """Runs a command again and again until its status is 0."""
        loop = f"until {{ {command}; }} >/tmp/until 2>&1; do sleep 0.5; done; cat /tmp/until"
        found = self(loop, status=None, timeout=timeout)
        if found.status:
            raise AssertionError(f"{command}: {self('cat /tmp/until', status=None).text}")
        return found

    def write(self, path: str, text: str) -> None:
        """Writes a file."""
        self(f"mkdir -p {Path(path).parent} && printf %s {shlex.quote(text)} >{path}")

    def monitor(self, command: str, **arguments: object) -> Any:
        """Carries out a command of QEMU's monitor (QMP)."""
        request = json.dumps({"execute": command, "arguments": arguments})
        self._monitor.write(request + "\n")
        self._monitor.flush()
        for line in self._monitor:
            reply = json.loads(line)
            if "error" in reply:
                raise AssertionError(f"{command}: {reply['error']}")
            if "return" in reply:
                return reply["return"]
        raise AssertionError(f"{command}: QEMU has ended")

    def reboot(self) -> None:
        """Starts the machine again, in order."""
        boot = self.text("cat /proc/sys/kernel/random/boot_id")
        self("systemctl reboot --no-block", status=None)
        end = time.monotonic() + PATIENCE_S
        while True:
            with suppress(TimeoutError):
                if self._ask("cat /proc/sys/kernel/random/boot_id", 20, 10).text.strip() != boot:
                    break
            assert time.monotonic() < end, "the machine does not come back"
        self.until("systemctl is-system-running --wait | grep -E 'running|degraded'", 300)

    def wait_until_it_answers(self) -> None:
        """Waits for the end of the boot."""
        end = time.monotonic() + PATIENCE_S
        while True:
            with suppress(TimeoutError):
                self._ask("true", 20, 5)
                return
            assert self._process.poll() is None, self._console()
            assert time.monotonic() < end, f"the machine does not answer:\n{self._console()}"

    def _console(self) -> str:
        return (self._folder / "console.log").read_text(errors="replace")[-2000:]

    def _ask(self, command: str, timeout: float, patience: float) -> Said:
        self._number += 1
        request = {"id": self._number, "command": command, "timeout": timeout}
        with suppress(ConnectionError):  # seen below
            self._agent.sendall(json.dumps(request).encode() + b"\n")
        end = time.monotonic() + patience
        while True:
            self._agent.settimeout(max(end - time.monotonic(), 0.001))
            *lines, self._pending = self._pending.split(b"\n")
            for line in lines:
                reply = json.loads(line)
                if reply["id"] == self._number:
                    return Said(reply["status"], reply["text"], reply["seconds"])
            try:
                data = self._agent.recv(65536)
            except ConnectionError:
                data = b""
            if not data:
                self._machine_is_gone()
            self._pending += data

    def _machine_is_gone(self) -> NoReturn:
        """Ends the tests: with a status of its own if QEMU itself has crashed."""
        status = self._process.wait(PATIENCE_S)
        if status < 0 and status != -signal.SIGKILL:
            name = signal.Signals(-status).name
            pytest.exit(f"QEMU itself has crashed ({name})", EMULATOR_CRASHED)
        raise AssertionError(f"the machine has ended:\n{self._console()}")


def _connect(path: Path, process: "subprocess.Popen[bytes]") -> socket.socket:
    end = time.monotonic() + 60
    while True:
        there = socket.socket(socket.AF_UNIX)
        try:
            there.connect(str(path))
        except OSError:
            there.close()
            assert process.poll() is None, "QEMU has ended at once"
            assert time.monotonic() < end
            time.sleep(0.1)
        else:
            return there


@contextmanager
def wires() -> Iterator[None]:
    """The far ends of the wires, in the network namespace of this process, a new one."""
    assert [name for _, name in socket.if_nameindex()] == ["lo"], "use make test-system"
    for number in range(2):
        subprocess.run(["ip", "tuntap", "add", f"tap{number}", "mode", "tap"], check=True)
        subprocess.run(["ip", "link", "set", f"tap{number}", "up"], check=True)
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    yield


@contextmanager
def segment(rig: str, number: int) -> Iterator[str]:
    """A simulated EtherCAT segment at a wire; gives its name for `ecatsim.control.Simulator`."""
    name = f"system{number}-{os.getpid()}"
    read, write = os.pipe()
    command = [sys.executable, "-m", "ecatsim", "run", rig, "--interface", f"tap{number}"]
    command += ["--name", name, "--ready-fd", str(write)]
    process = subprocess.Popen(command, pass_fds=(write,))
    os.close(write)
    try:
        with os.fdopen(read) as ready:
            assert ready.readline(), "the simulator does not start"
        yield name
    finally:
        process.terminate()
        process.wait()


if __name__ == "__main__":
    build(Path(sys.argv[1]))
