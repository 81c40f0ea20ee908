"""The console command. It is installed as a module of its own, `icpmodel_console`, beside the package: so it is there
before the package is imported, and Ctrl-C while that goes on is one line, too."""

import importlib
import os
import signal
import sys
import threading
from types import FrameType

#: where what starts several processes at once tells each of them its number
_RANKS = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "SLURM_PROCID")


def _leave(signum: int, frame: FrameType | None) -> None:
    """Nothing was begun that would have to be ended: what is half imported may turn an exception into another one."""
    if all(os.environ.get(name, "0") == "0" for name in _RANKS):
        os.write(2, b"icpmodel: interrupted\n")
    os._exit(130)


def main() -> None:
    """Import the command line, and run it."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    if any(name in os.environ for name in _RANKS):  # this is what mpiexec makes of Ctrl-C
        signal.signal(signal.SIGTERM, _leave)
    run = importlib.import_module("icpmodel.cli").main
    signal.signal(signal.SIGINT, before)
    try:
        run()
    except SystemExit as end:
        # a step that took longer than there was time is not waited for
        steps = sys.modules.get("icpmodel.numerics.threads")
        if steps is not None and any(thread.name == steps.LEFT for thread in threading.enumerate()):
            for stream in filter(None, (sys.stdout, sys.stderr)):
                stream.flush()
            os._exit(end.code if isinstance(end.code, int) else 0)
        raise


if __name__ == "__main__":
    main()
