"""Runs commands in the virtual machine.

Requests and replies are lines of JSON on a virtual serial port.
"""

import json
import subprocess
import time
from pathlib import Path

PORT = Path("/dev/virtio-ports/tests.agent")


def answer(request):
    started = time.monotonic()
    try:
        done = subprocess.run(
            ["/bin/sh", "-c", request["command"]],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=request["timeout"],
        )
        status, said = done.returncode, done.stdout
    except subprocess.TimeoutExpired as late:
        status, said = 124, late.stdout or b""
    text = said.decode(errors="replace")
    seconds = time.monotonic() - started
    return {"id": request["id"], "status": status, "text": text, "seconds": seconds}


def main():
    while True:
        try:
            with PORT.open("r+b", buffering=0) as port:
                pending = b""
                while True:
                    data = port.read(65536)
                    if not data:  # nobody is at the other end
                        time.sleep(0.2)
                        continue
                    pending += data
                    *lines, pending = pending.split(b"\n")
                    for line in lines:
                        reply = json.dumps(answer(json.loads(line))).encode() + b"\n"
                        while reply:
                            reply = reply[port.write(reply) :]
        except OSError:
            time.sleep(0.5)


main()
