"""Ctrl-C and `kill`: listened to before anything is loaded, which takes a third of a second."""

from __future__ import annotations

import os
import signal
from types import FrameType

INTERRUPTED = 130
"""Exit code of Ctrl-C, as shells have it: 128 and the signal's number."""

NOTHING_WRITTEN = "interrupted: nothing is written; finished odometry is kept, unless with --no-cache"


class Interruption:
    """Remembers that a signal came: what is at work may make another error of the interruption."""

    came = False
    at_work = False
    """Whether there may be something to tidy up: before, a signal ends the process at once."""

    @classmethod
    def listen(cls) -> None:
        """Ended by `kill`, or with its terminal: as by Ctrl-C, so that no worker and no scratch folder is left."""
        cls.came = False
        for ending in (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
            if signal.getsignal(ending) in {signal.SIG_DFL, signal.default_int_handler}:  # `nohup` has it ignored
                signal.signal(ending, cls.handle)

    @classmethod
    def handle(cls, number: int, frame: FrameType | None) -> None:
        """Ends what is at work, or the process where nothing is yet."""
        cls.came = True
        if cls.at_work:
            raise KeyboardInterrupt
        os.write(2, f"{NOTHING_WRITTEN}\n".encode())
        os._exit(INTERRUPTED)
