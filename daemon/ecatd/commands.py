"""Where the commands begin.

A command is loaded for a tenth of a second before it runs. Ctrl-C meanwhile ends it as it ends any
program, without a traceback.
"""

import importlib
import signal


def ecatd() -> int:
    """The daemon; returns the exit status."""
    return _run("ecatd.service.main")


def ecatctl() -> int:
    """The command line of the daemon; returns the exit status."""
    return _run("ecatd.cli.main")


def ecatsim() -> int:
    """The simulator; returns the exit status."""
    return _run("ecatsim.cli.main")


def _run(module: str) -> int:
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else it is ignored
    if ours:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    main = importlib.import_module(module).main
    if ours:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    status: int = main()
    return status
