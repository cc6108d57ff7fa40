"""The live page: what viewers get, who may be one, and that none of them holds a run up."""

import json
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

import cosim
from cosim.errors import InputError, SimulationError
from cosim.live import feed as feed_module
from cosim.live import server as server_module
from cosim.live.feed import Feed
from cosim.master.pacing import Pacer
from cosim.master.simulation import Simulation
from cosim.results.result import Result
from cosim.scenario.scenario import Scenario
from cosim.tests.driving import FailsAt

client = pytest.importorskip("websockets.sync.client")
from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402


class Viewer:
    """What the page does with what it gets."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket
        self.head: dict[str, Any] = {}
        self.end: dict[str, Any] = {}
        self.state: dict[str, Any] = {}
        self.rows: np.ndarray = np.empty((0, 0))
        self.count = self.ticks = 0

    def take(self) -> str:
        """Take a message; return its kind."""
        message = self.socket.recv(timeout=60)
        if isinstance(message, bytes):
            first, rows, beside, self.ticks = np.frombuffer(message, np.uint32, 4)
            columns = self.head["columns"]
            numbers = np.frombuffer(message, np.float64, offset=16).reshape(rows + beside, columns)
            self.count = int(first + rows + beside)
            self.rows[first : self.count] = numbers
            return "numbers"
        told = json.loads(message)
        if told["kind"] == "begin":
            self.head = told
            self.rows = np.full((told["rows"], told["columns"]), np.nan)
        elif told["kind"] in ("end", "state"):
            setattr(self, told["kind"], told)
        return str(told["kind"])

    def until(self, condition: Callable[[], object]) -> None:
        while not condition():
            self.take()

    def of(self, name: str, robot: str, component: int = 0) -> np.ndarray:
        """Return the course of a signal as far as it is known."""
        [signal] = [one for one in self.head["run"]["signals"]["list"] if one["name"] == name]
        [column] = signal["columns"][signal["robots"].index(robot)][component]
        return self.rows[: self.count, column]


@contextmanager
def viewer(live: cosim.LiveView, origin: str | None = "") -> Iterator[Viewer]:
    parts = urlsplit(live.address)
    options: Any = {"max_size": None, "compression": None, "open_timeout": 60, "close_timeout": 1}
    own = f"http://{parts.netloc}"
    with client.connect(
        f"ws://{parts.netloc}{parts.path}feed", origin=own if origin == "" else origin, **options
    ) as connected:
        yield Viewer(connected)


@contextmanager
def beside(simulation: Simulation, pacer: Pacer | None = None) -> Iterator[list[Any]]:
    """Run a simulation in a thread; its result or its failure is in the list once the block has ended."""
    outcome: list[Any] = []

    def run() -> None:
        try:
            outcome.append(simulation.run_to_end(pacer=pacer))
        except SimulationError as error:
            outcome.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield outcome
    finally:
        thread.join(60.0)


# What viewers get -------------------------------------------------------------------------------------------


def test_parts_of_the_records_are_parts_of_the_result(short_line: Scenario) -> None:
    with Simulation(short_line.edited(horizon=4.0)) as simulation:
        whole = simulation.run_to_end()
        before: Result | None = None
        for ticks in (slice(0, 1), slice(1, 90, 4), slice(93, 201, 4), slice(200, 201)):
            part = simulation.records.part(ticks, before)
            for name, signal in whole.data_vars.items():
                assert np.array_equal(part[name].values, signal.values[ticks], equal_nan=True), name
            assert np.array_equal(part["time"].values, whole["time"].values[ticks])
            before = part


@pytest.mark.parametrize("spaced", [False, True])
def test_a_feed_has_every_tick_or_evenly_spaced_ones_and_the_last(
    short_line: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spaced: bool
) -> None:
    event = '<event at="0.8 s" robots="follower_1"><parameter name="m_c" value="40 kg"/></event>'
    if spaced:
        monkeypatch.setattr(feed_module, "MOST_NUMBERS", 1)
        monkeypatch.setattr(feed_module, "_FEWEST", 10)
    text = short_line.path.read_text(encoding="utf-8").replace("<expect>", f"{event}<expect>")
    (tmp_path / "line.xml").write_text(text, encoding="utf-8")
    with Simulation(cosim.read_scenario(tmp_path / "line.xml").edited(horizon=1.0, expectations=False)) as simulation:
        feed = Feed(simulation.records)
        assert not feed.look()
        for _ in range(28):
            simulation.step()
        assert feed.look()
        assert not feed.look()
        result = simulation.recorded(None)
    head = json.loads(feed.head)
    every = head["every"]
    assert every == (6 if spaced else 1)  # of 51 ticks, ten
    assert head["run"]["status"] == "running"
    assert [event["time"] for event in head["run"]["events"]] == [0.8]
    assert head["run"]["verdicts"] == head["run"]["followers"] == []
    message, rows = feed.since(2)
    assert rows == feed.rows == len(range(0, 28, every))
    first, sent, last, ticks = np.frombuffer(message, np.uint32, 4)
    assert (first, sent, last, ticks) == (2, rows - 2, spaced, 28)
    numbers = np.frombuffer(message, np.float64, offset=16).reshape(sent + last, head["columns"])
    chosen = [*range(2 * every, 28, every), *([27] if spaced else [])]
    for robot, columns in enumerate(head["run"]["motion"]["poses"]):
        pose = result["pose"].values[:, robot - 1] if robot else result["leader_pose"].values
        for k, [column] in enumerate(columns):
            assert np.array_equal(numbers[:, column], pose[chosen, k])


def test_who_comes_late_gets_everything(short_line: Scenario) -> None:
    with cosim.LiveView(paused=True) as live, Simulation(short_line, observers=[live]) as simulation:
        with beside(simulation) as outcome, viewer(live) as early:
            early.until(lambda: early.ticks == 1 and early.state)
            assert early.state["paused"]
            for _ in range(3):
                early.socket.send("step")
            early.until(lambda: early.ticks == 4)
            with viewer(live) as late:
                late.until(lambda: late.ticks == 4)
                assert np.array_equal(late.rows, early.rows, equal_nan=True)
                late.socket.send("go on")
                for one in (early, late):
                    one.until(lambda one=one: one.end)
        [result] = outcome
        assert np.array_equal(early.of("pose", "follower_2", 1)[:4], result["pose"].values[:4, 1, 1])
        assert early.end == late.end
        assert early.end["run"]["status"] == "completed"
        assert early.end["run"]["samples"] == 51
        with viewer(live) as last:
            last.until(lambda: last.end)
            assert last.end == late.end
            assert last.head == {}


def test_the_end_has_the_verdicts(scenarios: Any) -> None:
    changes = ["//rms/@from=0.5 s", "//settled/@by=0.5 s"]
    scenario = cosim.read_scenario(scenarios / "clmr_line.xml", changes).edited(horizon=1.0)
    with cosim.LiveView() as live:
        with Simulation(scenario, observers=[live]) as simulation:
            result = simulation.run()
        with viewer(live) as one:
            one.until(lambda: one.end)
        expected = cosim.summary_of(result).verdicts
    shown = one.end["run"]["verdicts"]
    assert [(verdict["robot"], verdict["passed"]) for verdict in shown] == [(one.robot, one.passed) for one in expected]
    assert any(not verdict["passed"] for verdict in shown)


def test_a_run_that_fails_says_how_far_it_came_and_why(short_line: Scenario) -> None:
    fails = FailsAt(20, SimulationError("follower_2", 0.4, "it is out of order"))
    with cosim.LiveView() as live, Simulation(short_line, observers=[live, fails]) as simulation:
        with beside(simulation) as outcome, viewer(live) as one:
            one.until(lambda: one.end)
        assert isinstance(outcome[0], SimulationError)
        run = one.end["run"]
        assert run["status"] == "incomplete"
        assert run["failure"]["time"] == pytest.approx(0.4)
        assert run["samples"] == 21
        assert run["verdicts"] == []


def test_another_run_takes_the_place_of_the_one_before(short_line: Scenario) -> None:
    with cosim.LiveView() as live:
        with Simulation(short_line, observers=[live]) as simulation:
            simulation.run_to_end()
        with viewer(live) as one:
            one.until(lambda: one.end)
            with Simulation(short_line, observers=[live]) as simulation:
                simulation.run_to_end()
            assert "next" in iter(one.take, "")


# Nobody holds a run up --------------------------------------------------------------------------------------


@contextmanager
def never_reading(live: cosim.LiveView) -> Iterator[None]:
    """Be a viewer that takes nothing, as a browser that was stopped."""
    address = urlsplit(live.address)
    with socket.socket() as stopped:
        stopped.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        stopped.connect((address.hostname or "", address.port or 0))
        stopped.sendall(
            f"GET {address.path}feed HTTP/1.1\r\nHost: {address.netloc}\r\nOrigin: http://{address.netloc}\r\n"
            "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        yield


def test_ten_viewers_one_of_whom_never_reads(short_line: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "_LONGEST_CLOSE", 0.2)
    scenario = short_line.edited(horizon=400.0)
    with cosim.LiveView() as live, Simulation(scenario, observers=[live]) as simulation, never_reading(live):
        with ExitStack() as closing:
            viewers = [closing.enter_context(viewer(live)) for _ in range(9)]
            viewers[0].until(lambda: viewers[0].state.get("viewers") == 10)
            with beside(simulation) as outcome:
                for one in viewers:
                    one.until(lambda one=one: one.end)
        assert isinstance(outcome[0], Result)
        assert {one.end["run"]["samples"] for one in viewers} == {20_001}


def test_a_viewer_that_never_reads_is_none_after_a_while(short_line: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise the page, and a run that is paused, would wait for it for ever."""
    monkeypatch.setattr(server_module, "GRACE", 0.1)
    monkeypatch.setattr(server_module, "_LONGEST_SILENCE", 0.3)
    scenario = short_line.edited(horizon=400.0)
    with cosim.LiveView() as live, Simulation(scenario, observers=[live]) as simulation, never_reading(live):
        with viewer(live) as one:
            one.until(lambda: one.state.get("viewers") == 2)
        simulation.run_to_end()
        began = time.monotonic()
        live.wait(stopping=lambda: time.monotonic() > began + 30.0)
        assert not live._server._viewers


def test_a_paused_run_goes_on_when_the_last_viewer_has_left(
    short_line: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, "GRACE", 0.1)
    with cosim.LiveView(paused=True) as live, Simulation(short_line, observers=[live]) as simulation:
        with beside(simulation) as outcome:
            time.sleep(0.5)
            assert not outcome  # nobody has been there yet
            with viewer(live) as one:
                one.until(lambda: one.ticks == 1)
        assert outcome[0].attrs["status"] == "completed"


def test_a_viewer_can_leave_at_any_time(short_line: Scenario) -> None:
    with cosim.LiveView() as live, Simulation(short_line, observers=[live]) as simulation:
        with beside(simulation, Pacer(short_line.step, 2.0)) as outcome:
            for _ in range(4):
                with viewer(live) as one:
                    one.take()
        assert outcome[0].attrs["status"] == "completed"


# Who may be a viewer ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def live() -> Iterator[cosim.LiveView]:
    with cosim.LiveView() as made:
        yield made


def answer(url: str, **headers: str) -> tuple[int, Any, str]:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=60) as response:
            return response.status, response.headers, response.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.headers, error.read().decode()


def test_the_page(live: cosim.LiveView) -> None:
    status, headers, text = answer(live.address)
    address = urlsplit(live.address).netloc
    assert status == 200
    assert headers["Cache-Control"] == "no-store"
    assert headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "default-src 'none'; script-src 'sha256-" in text
    assert f"connect-src ws://{address};" in text
    assert "unsafe" not in text.partition("<title>")[0]


@pytest.mark.parametrize("end", ["", "x/", "/feed", "../", "%2e%2e/"])
def test_without_the_key_there_is_nothing(live: cosim.LiveView, end: str) -> None:
    root = live.address[: -len(urlsplit(live.address).path)]
    status, _, text = answer(f"{root}/{end}")
    assert status == 404
    assert "with its key" in text


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "localhost@evil.example"]
)
def test_a_name_of_another_site_is_refused(live: cosim.LiveView, host: str) -> None:
    assert answer(live.address, Host=host)[0] == 403


def test_it_may_be_reached_through_a_tunnel(live: cosim.LiveView) -> None:
    status, _, text = answer(live.address, Host="localhost:8000")
    assert status == 200
    assert "connect-src ws://localhost:8000;" in text


@pytest.mark.parametrize("origin", [None, "null", "http://evil.example", "http://127.0.0.1", "https://{address}"])
def test_pages_of_other_sites_are_refused(live: cosim.LiveView, origin: str | None) -> None:
    told = origin and origin.format(address=urlsplit(live.address).netloc)
    with pytest.raises(InvalidStatus) as refused, viewer(live, origin=told):
        pass
    assert refused.value.response.status_code == 403


def test_only_this_machine_can_reach_it(live: cosim.LiveView) -> None:
    address = urlsplit(live.address)
    assert address.hostname == "127.0.0.1"
    assert address.port != 0
    assert live._server._socket.getsockname()[0] == "127.0.0.1"
    assert len(address.path) > 20


@pytest.mark.parametrize("command", ["", "dance", "step", b"\0\1"])
def test_nonsense_is_passed_over(live: cosim.LiveView, command: str | bytes) -> None:
    with viewer(live) as one:
        one.socket.send(command)
        one.socket.send("pause")
        one.until(lambda: one.state.get("paused"))
        one.socket.send("go on")
        one.until(lambda: not one.state["paused"])
        assert live.gate.tick == -1


def test_who_says_too_much_is_no_viewer_any_more(live: cosim.LiveView) -> None:
    with viewer(live) as one:
        one.socket.send("x" * 1000)
        with pytest.raises(ConnectionClosed):
            one.until(lambda: False)


# Bad input --------------------------------------------------------------------------------------------------


def test_a_connection_that_says_nothing_does_not_disturb_the_end() -> None:
    """Browsers open some in reserve."""
    program = (
        "import cosim, socket, urllib.parse\n"
        "with cosim.LiveView() as live:\n"
        "    at = urllib.parse.urlsplit(live.address)\n"
        "    idle = socket.create_connection((at.hostname, at.port))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_a_port_that_is_taken(live: cosim.LiveView) -> None:
    port = urlsplit(live.address).port
    with pytest.raises(InputError, match=f"port {port} of 127.0.0.1 cannot be used: Address already in use; name"):
        cosim.LiveView(port or 0)


@pytest.mark.parametrize("port", [-1, 65536])
def test_a_port_that_does_not_exist(port: int) -> None:
    with pytest.raises(InputError, match=f"port {port} does not exist"):
        cosim.LiveView(port)


def test_without_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    with pytest.raises(InputError, match=r"needs the package 'websockets': pip install 'formation-cosim\[live\]'"):
        cosim.LiveView()


def test_a_fault_of_the_page_harms_no_run(short_line: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    def faulty(feed: Feed) -> bool:
        raise ZeroDivisionError("of the page")

    monkeypatch.setattr(Feed, "look", faulty)
    with cosim.LiveView(paused=True) as live, Simulation(short_line, observers=[live]) as simulation:
        with beside(simulation) as outcome, viewer(live) as one, pytest.raises(ConnectionClosed):
            one.until(lambda: False)
        assert outcome[0].attrs["status"] == "completed"
        assert "ZeroDivisionError('of the page')" in live.fault
