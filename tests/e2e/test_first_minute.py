"""The first minute of somebody new: the commands of the README, with no setting of the tests."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import names

pytestmark = [pytest.mark.unprivileged, pytest.mark.timeout(300)]

README = Path(__file__).parents[2] / "README.md"

# A machine with a new user `newbie`, whose processes see nothing of others. Root makes the user in
# a copy of /etc. An ordinary user who runs this test is the new user, in a namespace with the same
# number.
MACHINE = """
mount -t tmpfs -o mode=1777 none /dev/shm
mount -t tmpfs -o mode=755 none /run
ip link set lo up
home=/run/newbie
mkdir /run/newbie
if [ $OUTSIDE = 0 ]; then
  user=54320
  cp -a /etc /run/etc
  mount --bind /run/etc /etc
  useradd --uid $user --no-create-home --home-dir $home --shell /bin/sh newbie
  chown newbie: $home
  be="setpriv --reuid $user --regid $user --clear-groups"
  # Where others may not see the folder of this environment or of its Python, as in /root, these
  # alone are shown.
  closed_above() {
    closed= folder=$1
    while [ "$folder" != / ]; do
      folder=$(dirname "$folder")
      $be test -x "$folder" || closed=$folder
    done
  }
  for part in "$ENVIRONMENT" "$PYTHON_PREFIX"; do
    mkdir -p "/run/shown$part"
    mount --bind "$part" "/run/shown$part"
  done
  for part in "$ENVIRONMENT" "$PYTHON_PREFIX"; do
    if [ -e "$part" ]; then
      closed_above "$part"
      [ -n "$closed" ] || continue
      mount -t tmpfs -o mode=755 none "$closed"
    fi
    mkdir -p "$part"
    mount --bind "/run/shown$part" "$part"
  done
else
  user=$OUTSIDE
  be="unshare --user --map-user=$user --map-group=$user"
fi
trap 'rm -rf "/tmp/ecatd-$user"' EXIT
session=
as_newbie() {
  $be env -i HOME=$home PATH="$ENVIRONMENT/bin:/usr/bin:/bin" $session sh -c "cd; $1"
}
"""

COMMANDS = r"""
ecatd --simulate troll 2>log & daemon=$!
for i in $(seq 600); do grep -q "is in OP" log && break; kill -0 $daemon || break; sleep 0.2; done
cat log
%s
kill -INT $daemon
wait $daemon && echo ended
"""


def machine(script: str) -> str:
    """What a script prints on such a machine; it calls `as_newbie COMMANDS`."""
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    done = subprocess.run(
        ["unshare", *user, "--mount", "--net", "--ipc", "sh", "-ec", MACHINE + script],
        env={
            **os.environ,
            "OUTSIDE": str(os.geteuid()),
            "ENVIRONMENT": sys.prefix,
            "PYTHON_PREFIX": sys.base_prefix,
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def commands_of_readme() -> str:
    """The commands that the README asks for in the second terminal."""
    second = README.read_text().partition("In the second terminal")[2]
    block = re.search(r"```sh\n(.*?)```", second, re.DOTALL)
    assert block
    return block[1]


def test_a_new_user_runs_the_commands_of_the_readme() -> None:
    """Without a session and with one, where root's service has run and where it has not."""
    asked = commands_of_readme()
    names(asked, "ecatctl slaves", "sdo-read 0 0x6060", "generate TrollPlant")
    told = machine(f"""
echo "--- bare"
as_newbie '{COMMANDS % asked}'
mkdir -m 755 -p "/run/user/$user" /run/ecatd
[ $OUTSIDE != 0 ] || chown newbie "/run/user/$user"
chmod 700 "/run/user/$user"
echo "--- session of the user, folder of root"
session="XDG_RUNTIME_DIR=/run/user/$user"
as_newbie '{COMMANDS % "ecatctl state; ecatctl read"}'
echo "--- session of somebody else"
session=XDG_RUNTIME_DIR=/run
more="prlimit --rtprio=98 --memlock=unlimited"
if $more true 2>/dev/null; then be="$more $be"; echo "limits raised"; fi
as_newbie '{COMMANDS % "unset XDG_RUNTIME_DIR; ecatctl state; ecatctl read"}'
echo "--- left"
ls -A /run/ecatd /dev/shm/*
""")
    runs = told.split("--- ")[1:]
    for run in runs[:3]:
        names(run, "is in OP", "ended")
        assert not re.search(r"Traceback|^ecatctl: |error: ", run, re.MULTILINE), run
    names(runs[0], "Gold EtherCAT GCON Drive", "EL6751", "0x00 0", "models/TrollPlant")
    for run in runs[1:3]:
        names(run, "OP", "0x6041")
    # One line says what is missing, and the command that mends it, where root may raise limits.
    command = "'sudo prlimit --pid $$ --rtprio=98 --memlock=unlimited' in this shell"
    for run in runs[:3]:
        lines = [line for line in run.splitlines() if "no real time" in line]
        if "limits raised" in run and not lines:
            continue
        (line,) = lines
        assert len(line) < 250
        names(line, "'ecatctl doctor' says more")
        assert ("SCHED_FIFO, locked memory" in line or "SCHED_FIFO and locked memory" in line) == (
            command in line
        )
        assert (command in line) == ("limits raised" not in run)
    assert "ecat0" not in runs[3]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be several users")
def test_a_stranger_cannot_stop_the_start_of_a_new_user_without_a_word() -> None:
    """A FIFO where the bus had its name is in nobody's way; one at the folder is told at once."""
    told = machine("""
stranger="setpriv --reuid 54321 --regid 54321 --clear-groups"
start="timeout -k 1 100 ecatd --simulate line:1; echo status \\$?"
$stranger mkfifo /dev/shm/ecat.ecat0 "/dev/shm/ecat-$user"
as_newbie "$start"
$stranger rm "/dev/shm/ecat-$user"
rm -r "/tmp/ecatd-$user"
$stranger mkdir "/tmp/ecatd-$user"
as_newbie "$start"
""")
    assert told.count("status 6") == 2, told
    names(told, "/dev/shm/ecat-54320", "/tmp/ecatd-54320", "belongs to user 54321", "sudo rm -r")
    assert "Traceback" not in told
