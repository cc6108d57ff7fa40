"""A live page as an observer of a run."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from cosim.closing import Closing
from cosim.errors import Failure
from cosim.live.feed import Feed
from cosim.live.server import Server
from cosim.master.gate import Gate
from cosim.master.observer import Watched
from cosim.master.other_runs import run_other
from cosim.master.records import Records
from cosim.results.result import Result
from cosim.results.summary import Summary, summarise
from cosim.shared_memory import shared


class LiveView(Closing):
    """Shows runs on a page in the browser while they go on, one after the other; the page can pause them.

    >>> with cosim.LiveView() as live, cosim.Simulation(scenario, observers=[live]) as simulation:
    ...     print(live.address)
    ...     simulation.run()
    ...     live.wait()

    A server in a thread of this process serves the page, on the loopback address alone. No viewer slows a run, whether
    it is slow itself, stopped or gone. A run that a viewer has paused goes on when the last viewer has left.

    Parameters
    ----------
    port
        The port of the server; 0 for any that is free.
    paused
        Whether a run waits at its first tick until a viewer lets it go on.

    Attributes
    ----------
    address : str
        The address of the page, with a key that only those have who have seen it.
    gate : Gate
        Holds the run.

    Raises
    ------
    InputError
        The library ``websockets`` is not installed (``pip install 'formation-cosim[live]'``), or the port is taken.
    """

    def __init__(self, port: int = 0, *, paused: bool = False) -> None:
        self.gate = Gate(shared)
        self._paused = paused
        self._server = Server(self.gate, port)
        self.address = self._server.address
        self._feed: Feed | None = None
        self._run: Watched | None = None

    # Whoever leads a run ------------------------------------------------------------------------------------

    def show(self, records: Records) -> None:
        """Show a run that is about to begin."""
        if self._paused:
            self.gate.close()
        self._feed = Feed(records)
        self._server.show(self._feed)

    def finish(self, result: Result, summary: Summary) -> None:
        """Show the end of the run, with its verdicts."""
        if self._feed is not None:
            self._feed.finish(result, summary)
            self._server.tell()

    def wait(self, patience: float = float("inf"), stopping: Callable[[], bool] = lambda: False) -> None:
        """Wait until the last viewer of a run that has ended has left.

        Parameters
        ----------
        patience
            How long to wait for a first viewer [s].
        stopping
            Returns whether somebody wants to stop waiting.
        """
        if self.has_ended:
            self._server.wait(patience, stopping)

    @property
    def has_ended(self) -> bool:
        """Whether the page shows the end of a run."""
        return self._feed is not None and self._feed.has_ended

    @property
    def fault(self) -> str:
        """Why the page is served no more, though nobody has closed it; or nothing."""
        return self._server.fault

    def close(self) -> None:
        """End the server; whoever has the page open keeps what it shows."""
        self.gate.open()
        self._server.close()

    # An observer --------------------------------------------------------------------------------------------

    @property
    def every_tick(self) -> bool:
        """Whether it wants to be told of every tick: while a run is paused."""
        return self.gate.every_tick

    @property
    def held(self) -> float:
        """How long it has held runs [s]."""
        return self.gate.held

    def started(self, run: Watched) -> None:
        """Show the run."""
        self._run = run
        self.gate.started(run)
        self.show(run.records)

    def ticked(self, tick: int) -> None:
        """Hold the run where a viewer has paused it."""
        self.gate.ticked(tick)

    def ended(self, failure: Failure | None) -> None:
        """Show how the run has ended, with the verdicts on a complete one."""
        assert self._run is not None, "the run has started"
        records = self._run.records
        result = records.whole(failure)
        self.finish(result, summarise(records.scenario, result, partial(run_other, records.setup)))
