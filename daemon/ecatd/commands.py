"""Entry points of the commands.

Loading the modules of a command takes about a tenth of a second. During this time, Ctrl-C ends the
process by the signal, without a traceback. The daemon ignores SIGHUP meanwhile, which would end it
by default: it is too early to read the configuration again.
"""

import importlib
import signal


def ecatd() -> int:
    """Runs the daemon; returns the exit status."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    return _run("ecatd.service.main")


def ecatctl() -> int:
    """Runs the command line of the daemon; returns the exit status."""
    return _run("ecatd.cli.main")


def ecatsim() -> int:
    """Runs the simulator; returns the exit status."""
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
