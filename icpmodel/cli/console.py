"""The console command. It is installed as a module of its own, `icpmodel_console`, beside the package: so it is there
before the package is imported, and Ctrl-C while that goes on is one line, too."""

import importlib
import os
import signal
from types import FrameType


def _leave(signum: int, frame: FrameType | None) -> None:
    """Nothing was begun that would have to be ended: what is half imported may turn an exception into another one."""
    os.write(2, b"icpmodel: interrupted\n")
    os._exit(130)


def main() -> None:
    """Import the command line, and run it."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    run = importlib.import_module("icpmodel.cli").main
    signal.signal(signal.SIGINT, before)
    run()


if __name__ == "__main__":
    main()
