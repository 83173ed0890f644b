"""A Zenoh client that tries what it may not do; `test_attacks.py` tells it what, line by line.

The argument is its settings for Zenoh. It says `true` if it is let in. Each line that it reads is a
verb with keys, a payload and seconds, and each line that it writes is the result.
"""

import json
import sys
import time
from collections.abc import Sequence
from typing import Any

import zenoh

from ecatd.operations.zenoh_keys import session_config

FORGED = b"forged"
REMOTE = zenoh.Locality.REMOTE
"""What he asks and answers himself does not count."""


class Attacker:
    """The verbs.

    Args:
        session: Its connection to the gateway.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: list[Any] = []
        self._caught: list[str] = []

    def query(self, keys: Sequence[str], payload: bytes | None, seconds: float) -> list[str]:
        """Returns what happens to a query at each key: `answered`, `refused` or `–`."""
        gets = [
            self._session.get(key, payload=payload, timeout=seconds, allowed_destination=REMOTE)
            for key in keys
        ]
        return [
            "answered" if any(reply.ok for reply in replies) else "refused" if replies else "–"
            for replies in map(list, gets)
        ]

    def alive(self, keys: Sequence[str], _payload: None, seconds: float) -> list[str]:
        gets = [self._session.liveliness().get(key, timeout=seconds) for key in keys]
        return ["answered" if list(replies) else "–" for replies in gets]

    def put(self, keys: Sequence[str], *_: object) -> None:
        for key in keys:
            self._session.put(key, FORGED)

    def delete(self, keys: Sequence[str], *_: object) -> None:
        for key in keys:
            self._session.delete(key)

    def answer(self, keys: Sequence[str], *_: object) -> None:
        caught = self._caught

        def reply(query: zenoh.Query) -> None:
            caught.append(str(query.selector))
            query.reply(query.key_expr, FORGED)

        for key in keys:
            for complete in (False, True):
                self._declared.append(
                    self._session.declare_queryable(
                        key, reply, complete=complete, allowed_origin=REMOTE
                    )
                )

    def listen(self, keys: Sequence[str], *_: object) -> None:
        caught = self._caught

        def hear(sample: zenoh.Sample) -> None:
            caught.append(str(sample.key_expr))

        self._declared += [self._session.declare_subscriber(key, hear) for key in keys]

    def live(self, keys: Sequence[str], *_: object) -> None:
        self._declared += [self._session.liveliness().declare_token(key) for key in keys]

    def end(self, _keys: object, _payload: object, seconds: float) -> list[str]:
        """Ends what it has declared, and returns what it has caught within so many seconds."""
        deadline = time.monotonic() + seconds
        while not self._caught and time.monotonic() < deadline:
            time.sleep(0.02)
        for item in self._declared:
            item.undeclare()
        self._declared.clear()
        # What is still on its way comes into the old list, and not to the next attempt.
        caught, self._caught = [*self._caught], []
        return caught


def main() -> None:
    try:
        session = zenoh.open(session_config("client", json.loads(sys.argv[1])))
    except zenoh.ZError:
        print("false", flush=True)
        return
    with session:
        attacker = Attacker(session)
        print("true", flush=True)
        for line in sys.stdin:
            verb, keys, payload, seconds = json.loads(line)
            data = None if payload is None else bytes.fromhex(payload)
            print(json.dumps(getattr(attacker, verb)(keys, data, seconds)), flush=True)


if __name__ == "__main__":
    main()
