"""The server of a live page: on the loopback address alone, in a thread, for those who know the page's key.

Each viewer gets what it lacks as soon as it has taken what it was sent: one that is slow gets more at once, and nobody
waits for it. Other sites' pages cannot read or use it: they know no key, a name of theirs that leads to this machine is
no name of the server, and what comes from their pages says so in its origin.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import logging
import os
import re
import secrets
import socket
import threading
import time
from collections.abc import AsyncIterator, Callable
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

from cosim.errors import InputError
from cosim.live.feed import Feed, in_json
from cosim.master.gate import Gate
from cosim.report.page import OF_RUNS, page

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

HOST = "127.0.0.1"
LIVE_SCRIPTS = (*OF_RUNS, "live.js")
_NAMES = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d{1,5})?")
"""Names under which a browser may know the server, also through a tunnel from another port."""
_PERIOD = 0.1
"""Shortest time [s] between two looks at the run."""
_REST = 40
"""How many times as long as a look takes the server rests after it, as the run may go on in the same process."""
GRACE = 3.0
"""Time [s] in which a viewer that has left may come back, as one does that loads the page anew."""
_LONGEST_SILENCE = 60.0
"""Time [s] after which a viewer that takes nothing of what it is sent counts as one that has left."""
_LONGEST_CLOSE = 1.0
_LONGEST_COMMAND = 64
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_LOG = logging.getLogger("cosim.live")


class Server:
    """Serves the page of a run, in a thread.

    Parameters
    ----------
    gate
        Holds the run where a viewer asks for it.
    port
        The port; 0 for any that is free.

    Attributes
    ----------
    address : str
        The address of the page, with its key.
    fault : str
        Why the server has ended by itself, or nothing.

    Raises
    ------
    InputError
        The library ``websockets`` is not installed, or the port is taken.
    """

    def __init__(self, gate: Gate, port: int = 0) -> None:
        try:
            import websockets.asyncio.server  # noqa: F401
        except ImportError:
            raise InputError(
                "a live page needs the package 'websockets': pip install 'formation-cosim[live]'"
            ) from None
        self._gate = gate
        self._socket = _listening(port)
        self._key = secrets.token_urlsafe(16)
        self.address = f"http://{HOST}:{self._socket.getsockname()[1]}/{self._key}/"
        self.fault = ""
        self._feed: Feed | None = None
        self._viewers: set[Any] = set()
        self._knowing: set[Any] = set()  # viewers that have the end of the run
        self._seen = False  # whether there has been a viewer
        self._left = time.monotonic()
        self._news = asyncio.Event()
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="live page", daemon=True)
        self._thread.start()

    # Another thread -----------------------------------------------------------------------------------------

    def show(self, feed: Feed) -> None:
        """Show a run, in place of the one before."""
        self._feed = feed
        self.tell()

    def tell(self) -> None:
        """Let viewers know that there is something new."""
        with contextlib.suppress(RuntimeError):  # it is closed
            self._loop.call_soon_threadsafe(self._wake)

    def wait(self, patience: float, stopping: Callable[[], bool] = lambda: False) -> None:
        """Wait until the last viewer has left; see `LiveView.wait`."""
        began = time.monotonic()
        while not stopping() and self._thread.is_alive():
            now = time.monotonic()
            if not self._viewers and now > (self._left + GRACE if self._seen else began + patience):
                return
            time.sleep(_PERIOD)

    def close(self) -> None:
        """End the server; viewers keep what they have."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(5 * _LONGEST_CLOSE)

    # The thread ---------------------------------------------------------------------------------------------

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._socket.close()
            self._loop.close()

    async def _serve(self) -> None:
        from websockets.asyncio.server import serve

        _LOG.addHandler(logging.NullHandler())
        _LOG.propagate = False
        options: dict[str, Any] = {"compression": None, "server_header": None, "logger": _LOG}
        limits: dict[str, Any] = {"max_size": _LONGEST_COMMAND, "close_timeout": _LONGEST_CLOSE}
        server = await serve(self._view, sock=self._socket, process_request=self._answer, **options, **limits)
        looking, stopping = map(self._loop.create_task, (self._look_on(), self._stop.wait()))
        await asyncio.wait((looking, stopping), return_when=asyncio.FIRST_COMPLETED)
        if looking.done():
            self.fault = f"the live page has ended: {looking.exception()!r}"
            self._gate.open()
        looking.cancel()
        if self._feed is not None and self._feed.has_ended:
            await self._let_know()
        stopping.cancel()
        server.close()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(server.wait_closed(), 2 * _LONGEST_CLOSE)
        rest = asyncio.all_tasks() - {asyncio.current_task()}  # of connections that have never said anything
        for task in rest:
            task.cancel()
        if rest:
            await asyncio.wait(rest, timeout=_LONGEST_CLOSE)

    async def _let_know(self) -> None:
        """Wait a little until all viewers know how the run has ended."""
        give_up = time.monotonic() + _LONGEST_CLOSE
        while self._viewers - self._knowing and time.monotonic() < give_up:
            await asyncio.sleep(_PERIOD / 10)

    def _wake(self) -> None:
        self._news.set()
        self._news = asyncio.Event()

    async def _look_on(self) -> None:
        """Look at the run while somebody watches it; open its gate once nobody does."""
        while True:
            feed, rest = self._feed, 0.0
            if self._viewers and feed is not None:
                began, at_work = time.thread_time(), feed.ticks > 0  # the first look is longer than any other
                if feed.look():
                    self._wake()
                rest = _REST * (time.thread_time() - began) if at_work else 0.0
            elif self._gate.is_closed and self._seen and time.monotonic() > self._left + GRACE:
                self._gate.open()
            await asyncio.sleep(max(_PERIOD, rest))

    # Viewers ------------------------------------------------------------------------------------------------

    async def _view(self, viewer: ServerConnection) -> None:
        self._viewers.add(viewer)
        self._seen = True
        self._wake()
        feeding, heeding = map(self._loop.create_task, (self._tell(viewer), self._heed(viewer)))
        try:
            await asyncio.wait((feeding, heeding), return_when=asyncio.FIRST_COMPLETED)
        finally:
            feeding.cancel()
            heeding.cancel()
            self._viewers.discard(viewer)
            self._knowing.discard(viewer)
            self._left = time.monotonic()
            self._wake()

    async def _tell(self, viewer: ServerConnection) -> None:
        """Send a viewer what it lacks."""
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            async for message in self._messages(viewer):
                if not await _taken(viewer, message):
                    return

    async def _messages(self, viewer: ServerConnection) -> AsyncIterator[str | bytes]:
        """Yield what a viewer lacks, whenever it has taken the message before."""
        shown: Feed | None = None
        rows = ticks = 0
        told, begun, ended = "", False, False
        while True:
            news, feed = self._news, self._feed
            if shown is not None and feed is not shown:
                yield in_json(kind="next")
                return
            shown = feed
            if feed is not None and feed.has_ended and not ended:
                ended = True
                yield feed.end
                self._knowing.add(viewer)
            if feed is not None and feed.head and not begun and not ended:
                begun = True
                yield feed.head
            while begun and feed is not None and ticks < feed.ticks and not ended:
                message, rows = feed.since(rows)
                ticks = feed.ticks if rows == feed.rows else 0
                yield message
            state = in_json(kind="state", paused=self._gate.is_closed, viewers=len(self._viewers))
            if state != told:
                told = state
                yield state
            if news is self._news:
                await news.wait()

    async def _heed(self, viewer: ServerConnection) -> None:
        """Do what a viewer asks for."""
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            async for command in viewer:
                if command == "pause":
                    self._gate.close()
                elif command == "go on":
                    self._gate.open()
                elif command == "step" and self._gate.is_closed:
                    self._gate.step()
                self._wake()

    # Requests -----------------------------------------------------------------------------------------------

    def _answer(self, viewer: ServerConnection, request: Request) -> Response | None:
        """Answer a request; None if it may become a viewer."""
        names, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(names) != 1 or not _NAMES.fullmatch(names[0]):
            return _respond(HTTPStatus.FORBIDDEN, "This server answers to 127.0.0.1 and localhost alone.")
        home = f"/{self._key}/".encode()
        path = request.path.encode("utf-8", "surrogateescape")
        if hmac.compare_digest(path, home):
            title = "A run, live"
            text = page(title, {}, LIVE_SCRIPTS, f"ws://{names[0]}")
            return _respond(HTTPStatus.OK, text, "text/html; charset=utf-8")
        if hmac.compare_digest(path, home + b"feed"):
            if origins != [f"http://{names[0]}"]:
                return _respond(HTTPStatus.FORBIDDEN, "Only the page of this server may ask for this.")
            return None
        return _respond(HTTPStatus.NOT_FOUND, "The address is the one that the run has printed, with its key.")


async def _taken(viewer: ServerConnection, message: str | bytes) -> bool:
    """Send a viewer a message; return whether it takes it. One that does not is no viewer any more.

    The library's own pings do not end it: they, too, wait until there is room to send them.
    """
    sending = asyncio.ensure_future(viewer.send(message))
    try:
        left = float("inf")
        while not (await asyncio.wait((sending,), timeout=_LONGEST_SILENCE))[0]:
            before, left = left, viewer.transport.get_write_buffer_size()
            if left >= before:
                viewer.transport.abort()
                return False
        await sending
        return True
    finally:
        sending.cancel()


def _listening(port: int) -> socket.socket:
    if not 0 <= port <= 65535:
        raise InputError(f"port {port} does not exist: ports go from 1 to 65535, and 0 stands for any that is free")
    try:
        return socket.create_server((HOST, port), backlog=64)
    except OSError as error:
        raise InputError(
            f"port {port} of {HOST} cannot be used: {os.strerror(error.errno or 0)}; name another one, or none for any "
            "that is free"
        ) from None


def _respond(status: HTTPStatus, text: str, kind: str = "text/plain; charset=utf-8") -> Response:
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    body = text.encode()
    headers = {**_HEADERS, "Content-Type": kind, "Content-Length": str(len(body)), "Connection": "close"}
    return Response(status.value, status.phrase, Headers(headers), body)
