"""Kills a run of `ecatgen.output.install` at every point; a program of its own, since it forks.

    killed_install.py FOLDER exchange|rename

Each run in FOLDER/N has a child that dies before its Nth operation on the file system. Prints, as
JSON, what was found after that, and after the next run.
"""

import json
import os
import sys
from pathlib import Path

from ecatgen.output import install, swap

OLD = {"a": b"old", "b": b"same", "gone/c": b"old", "package.order": b"a\n"}
NEW = {"a": b"new", "b": b"same", "sub/d": b"new", "package.order": b"a\n"}


def files(folder: Path) -> dict[str, str]:
    found = (path for path in folder.rglob("*") if path.is_file())
    return {p.relative_to(folder).as_posix(): p.read_text() for p in found if p.name[0] != "."}


def put(out: Path, tree: dict[str, bytes]) -> None:
    install(out, {"Plant": tree}, "Plant")


def die_before(number: int) -> None:
    seen = 0

    def hook(event: str, _: object) -> None:
        nonlocal seen
        if event.startswith(("os.", "open", "shutil.")):
            seen += 1
            if seen > number:
                os._exit(9)

    sys.addaudithook(hook)


def killed(out: Path, number: int) -> bool:
    """Whether the child died; else it was through before."""
    pid = os.fork()
    if pid == 0:
        die_before(number)
        put(out, NEW)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 9


def main() -> None:
    folder, way = Path(sys.argv[1]), sys.argv[2]
    if way == "rename":
        swap._exchange_at_once = lambda *_: False  # type: ignore[assignment]
    found = []
    for number in range(10_000):
        out = folder / str(number)
        put(out, OLD)
        (out / "Plant" / "Mine.mo").write_text("mine")
        died = killed(out, number)
        after = files(out / "Plant") if (out / "Plant").exists() else None
        put(out, NEW)
        left = [path.name for path in out.iterdir() if path.name != "Plant"]
        found.append([died, after, files(out / "Plant"), left])
        if not died:
            break
    print(json.dumps(found))


if __name__ == "__main__":
    main()
