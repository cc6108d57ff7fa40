"""``formation run --live``: the page that shows runs while they go on."""

from __future__ import annotations

import argparse
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from cosim.cli.console import err, say, warn
from cosim.cli.options import refuse
from cosim.master.interrupt import HeldSignals

if TYPE_CHECKING:
    from cosim.live.view import LiveView

_PATIENCE_FOR_A_BROWSER = 30.0
"""How long a browser that was opened may take to load the page [s]."""


@contextmanager
def watched(options: argparse.Namespace) -> Iterator[LiveView | None]:
    """Serve the live page if it is asked for; None without.

    Raises
    ------
    InputError
        The page cannot be served, or an option is for a live page alone.
    """
    if not options.live:
        refuse(options, ("--open", "--port", "--paused"), "is about the live page: add --live, or leave it out")
        yield None
        return
    from cosim.live.view import LiveView

    with LiveView(options.port or 0, paused=options.paused) as live:
        err().print(f"live page: {live.address}", markup=False, soft_wrap=True)
        patience = _opened(live.address) if options.open else 0.0
        yield live
        _stay(live, float("inf") if err().is_terminal else patience)
        if live.fault:
            warn(live.fault)


def _stay(live: LiveView, patience: float) -> None:
    """Serve the page on until its last viewer has left, or Ctrl-C; without a terminal nobody waits for a first one."""
    with HeldSignals() as signals:
        if live.has_ended and err().is_terminal:
            say(err(), "the live page stays until it is closed in the browser, or Ctrl-C")
        live.wait(patience, lambda: signals.received > 0)


def _opened(address: str) -> float:
    """Open the page in the browser; return how long to wait for it [s]."""
    import webbrowser

    if sys.platform == "linux" and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))):
        warn("--open: there is no display here, so no browser was opened; the address is above")
        return 0.0
    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
    return _PATIENCE_FOR_A_BROWSER
