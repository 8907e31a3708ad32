"""The pieces of the socket by themselves: lines, the motion right, tiers of age, the outbox."""

from __future__ import annotations

import asyncio
import grp
import json
import math
import os
import socket
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.cli.support.render_status import BAR, bar
from contid.control.engine.tick_layout import RecordLayout, RobotLayout
from contid.errors import ContidError
from contid.remote.client.move_arguments import columns_and_rows, point
from contid.remote.protocol import socket_path as place
from contid.remote.protocol.peer_credentials import PeerCredentials, is_authorized, peer_of
from contid.remote.protocol.socket_path import Endpoint, SocketError, default_path, find, is_listening
from contid.remote.protocol.wire import Code, NoDaemonError, RemoteError, RequestFields, decode, encode
from contid.remote.server.health import Staleness, bus_health, staleness_of
from contid.remote.server.lease import Lease
from contid.remote.server.outbox import MAX_FRAMES, MAX_RESPONSES, Outbox


@given(st.binary(max_size=400))
def test_any_bytes_are_an_object_or_a_refusal(line: bytes) -> None:
    try:
        found: object = decode(line)
    except RemoteError as error:
        found = {"code": error.code}
    assert isinstance(found, dict)


@pytest.mark.parametrize("line", [b"[" * 60_000, b"{" * 60_000, b'{"a":NaN}', b'{"a":1e', b"1" * 5000, b"[]"])
def test_traps_are_refused(line: bytes) -> None:
    with pytest.raises(RemoteError):
        decode(line)


def test_numbers_that_json_has_no_word_for_become_null() -> None:
    assert json.loads(encode({"a": float("nan"), "b": [float("inf"), 1.5]})) == {"a": None, "b": [None, 1.5]}


def test_a_field_nobody_asked_for_is_refused() -> None:
    take = RequestFields({"id": 1, "verb": "hold", "robot": "left"})
    assert take.names("robots") is None
    with pytest.raises(RemoteError, match="'robot'"):
        take.end()


@pytest.mark.parametrize(
    ("take", "right", "wrong"),
    [
        (lambda take: take.text("x", ""), ["", "a" * 200], [1, None, ["a"], "a" * 201]),
        (lambda take: take.number("x", 1.0, 0.0, 2.0), [0, 1.5, 2], [-0.1, 2.1, True, "1", None, math.nan]),
        (lambda take: take.flag("x"), [True, False], [1, "true", None]),
        (lambda take: take.names("x"), [["a", "b"], []], ["a", [1], {"a": 1}]),
        (lambda take: take.mapping("x"), [{}, {"a": 1}, None], [[], 1, "a", False]),
        (lambda take: take.rows("x"), [[], [[1, 2.5]], [[]]], [None, {}, [1], [["1"]], [[True]], [[None]]]),
    ],
    ids=["text", "number", "flag", "names", "mapping", "rows"],
)
def test_a_field_of_another_kind_is_refused_by_name(
    take: Callable[[RequestFields], object], right: list[object], wrong: list[object]
) -> None:
    for value in right:
        found = take(RequestFields({"x": value}))
        assert (list(found) if isinstance(found, tuple) else found) == value
    for value in wrong:
        with pytest.raises(RemoteError, match=r"^x: "):
            take(RequestFields({"x": value}))


def test_the_lease_has_one_holder_and_an_explicit_takeover() -> None:
    lease = Lease(0.0, input_active=False)
    lease.require(1, "one", 0.0)
    with pytest.raises(RemoteError, match="'one' has held the lease for 1"):
        lease.require(2, "two", 1.0)
    before = lease.acquire(2, "two", 1.0, takeover=True)
    assert before is not None
    assert before.client == 1
    assert lease.held_by(2)
    with pytest.raises(RemoteError, match=r"'two' has held the lease for 2\.5 s"):
        lease.require(1, "one", 3.5)
    assert lease.as_fields(3.5) == {"holder": "two", "client": 2, "since_s": 2.5}


def test_the_lease_lapses_without_requests_of_its_holder() -> None:
    lease = Lease(0.0, input_active=False)
    lease.acquire(1, "one", 0.0, timeout_s=2.0)
    lease.refresh(1, 1.9)
    lease.refresh(2, 3.5)
    assert lease.expire(3.8) is None
    assert lease.expire(4.0) is not None
    assert lease.holder is None


def test_the_input_holds_the_lease_until_a_takeover_and_may_be_resumed() -> None:
    lease = Lease(0.0, input_active=True)
    with pytest.raises(RemoteError, match="own input"):
        lease.require(1, "one", 0.0)
    lease.allow(1, 0.0)
    assert lease.expire(1e9) is None
    assert lease.revoke(1, "one (hold)") is None
    assert lease.held_by(0)
    lease.acquire(1, "one", 0.0, takeover=True)
    assert not lease.held_by(0)


def test_a_lease_revoked_by_a_stop_must_be_acquired_explicitly() -> None:
    lease = Lease(0.0, input_active=False)
    lease.require(1, "script", 0.0)
    assert lease.revoke(2, "person (estop)") is not None
    with pytest.raises(RemoteError) as refused:
        lease.require(1, "script", 0.1)
    assert refused.value.code == Code.STOPPED
    lease.acquire(1, "script", 0.2)
    lease.require(1, "script", 0.3)


def test_tiers_follow_the_age_and_the_rate() -> None:
    at_200_hz = [
        staleness_of(age_s, 0.005) for age_s in (0.0, 0.015, 0.016, 0.05, 0.1, 0.5, 1.1, float("inf"))
    ]
    fresh, late, stale, old, lost = Staleness
    assert at_200_hz == [fresh, fresh, late, late, stale, old, lost, lost]
    assert staleness_of(0.15, 0.05) is Staleness.FRESH
    assert staleness_of(0.16, 0.05) is Staleness.STALE


def test_a_bus_is_as_old_as_its_oldest_axis_and_names_those_that_are_silent() -> None:
    layout = RecordLayout("robots", 200.0, (RobotLayout("one", "x", "mm", ("left", "right", "never")),))
    packer = layout.packer()
    blank = packer.unpack(bytes(packer.size))
    record = layout.decode(blank)
    axis = record.robots[0].axes[0]
    read = (
        axis._replace(value=1.0, time_s=9.99, valid=1.0),
        axis._replace(value=1.0, time_s=9.90, valid=0.0),
        axis._replace(value=math.nan, time_s=10.0, valid=0.0),
    )
    record = record._replace(robots=(record.robots[0]._replace(axes=read),))
    buses = {"a": ["one.left"], "b": ["one.left", "one.right"], "c": ["one.left", "one.never"], "d": []}
    health = bus_health(layout, record, buses, 10.0)
    assert {name: one.silent for name, one in health.items()} == {
        "a": (), "b": ("one.right",), "c": ("one.never",), "d": (),
    }  # fmt: skip
    assert [one.age_s for one in health.values()] == pytest.approx([0.01, 0.1, math.inf, math.inf])
    assert [one.tier for one in health.values()] == [
        Staleness.FRESH,
        Staleness.STALE,
        Staleness.LOST,
        Staleness.LOST,
    ]


async def test_an_outbox_keeps_the_newest_frames_and_every_answer() -> None:
    outbox = Outbox()
    for number in range(MAX_FRAMES + 5):
        outbox.put_frame(b"%d" % number)
    outbox.put(b"answer")
    assert (outbox.dropped, await outbox.get(), await outbox.get()) == (5, b"answer", b"5")
    for _ in range(MAX_RESPONSES):
        outbox.put(b"")
    assert not outbox.overflowed
    outbox.put(b"")
    assert outbox.overflowed


def test_a_socket_is_private_and_a_second_daemon_is_refused(own_folder: Path) -> None:
    path = own_folder / "s"
    with Endpoint(path):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        with pytest.raises(SocketError, match="another daemon listens"):
            Endpoint(path)
        assert is_listening(path)
    assert not path.exists()


def test_what_a_killed_daemon_left_is_removed_and_what_is_no_socket_is_not(own_folder: Path) -> None:
    path = own_folder / "s"
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(path))
    assert path.exists()
    with Endpoint(path):
        assert is_listening(path)
    path.write_text("a file")
    with pytest.raises(SocketError, match="is not a socket"):
        Endpoint(path)
    assert path.read_text() == "a file"


def test_an_endpoint_removes_only_its_own_socket(own_folder: Path) -> None:
    path = own_folder / "s"
    first = Endpoint(path)
    path.unlink()
    second = Endpoint(path)
    first.close()
    assert path.exists()
    second.close()


def test_a_folder_that_others_may_enter_is_refused(own_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own_folder))
    (own_folder / "contid").mkdir(mode=0o755)
    (own_folder / "contid").chmod(0o755)
    with pytest.raises(SocketError, match="0700"):
        Endpoint(default_path("hand.yaml"), default=True)


def test_paths_too_long_for_a_socket_are_named(own_folder: Path) -> None:
    with pytest.raises(SocketError, match="107 bytes"):
        Endpoint(own_folder / ("s" * 200))


def test_the_only_daemon_is_found_and_several_are_listed(
    own_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own_folder))
    monkeypatch.setattr(place, "SERVICES", own_folder / "services")
    with pytest.raises(NoDaemonError, match="no daemon runs"):
        find(None)
    with Endpoint(default_path("configs/hand.yaml"), default=True) as hand:
        assert find(None) == hand.path == own_folder / "contid" / "hand.sock"
        with Endpoint(default_path("arm.emulated.yaml"), default=True) as arm:
            with pytest.raises(NoDaemonError, match="2 daemons run") as several:
                find(None)
            assert f"--socket {arm.path}" in str(several.value)
    place.SERVICES.mkdir()
    with Endpoint(place.SERVICES / "hand.sock") as service:
        assert find(None) == service.path


def test_without_a_runtime_folder_the_socket_is_in_a_folder_of_this_user(
    own_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setattr("tempfile.tempdir", str(own_folder))
    assert place.private_directory() == own_folder / f"contid-{os.geteuid()}"
    assert stat.S_IMODE(place.default_directory().stat().st_mode) == 0o700


def test_credentials_are_the_kernels() -> None:
    one, other = socket.socketpair()
    with one, other:
        peer = peer_of(one)
    assert peer.uid == os.geteuid()
    assert peer.groups == {os.getegid(), *os.getgroups()}
    own, root = PeerCredentials(os.geteuid(), frozenset()), PeerCredentials(0, frozenset())
    stranger = PeerCredentials(os.geteuid() + 1, frozenset({7, 8}))
    assert is_authorized(own, None)
    assert is_authorized(root, None)
    assert not is_authorized(stranger, None)
    assert not is_authorized(stranger, 9)
    assert is_authorized(stranger, 8)


def test_a_group_is_let_in_only_when_it_was_named(own_folder: Path) -> None:
    group = grp.getgrgid(os.getegid()).gr_name
    for name, mode in ((None, 0o600), (group, 0o660)):
        with Endpoint(own_folder / "s", group=name) as endpoint:
            assert stat.S_IMODE(endpoint.path.stat().st_mode) == mode
            assert endpoint.path.stat().st_gid == os.getegid()
    with pytest.raises(SocketError, match="no such group"):
        Endpoint(own_folder / "s", group="no-such-group")


def test_points_and_rows_as_a_person_writes_them() -> None:
    assert point(["left", "x_mm=40", "y_mm=75"]) == {"left.x_mm": 40.0, "left.y_mm": 75.0}
    assert point(["x_mm=4e1"]) == {"x_mm": 40.0}
    for wrong in (["x_mm=far"], ["left"], ["x_mm=1", "y_mm"]):
        with pytest.raises(ContidError):
            point(wrong)
    columns, rows = columns_and_rows(["# a circle\n", "t_s,x_mm\n", "0,1\n", "\n", "1,2\n"])
    assert (columns, list(rows)) == (["t_s", "x_mm"], [[0.0, 1.0], [1.0, 2.0]])
    columns, rows = columns_and_rows(["x_mm\n", "one\n"])
    with pytest.raises(ContidError, match="trajectory:2"):
        list(rows)


def test_bars_stay_within_their_width() -> None:
    assert [len(bar(value, 0.0, 10.0)) for value in (None, -5.0, 0.0, 5.0, 10.0, 50.0)] == [BAR] * 6
    assert bar(5.0, 0.0, 10.0).count("█") == BAR // 2


async def test_stopping_is_never_queued_behind_the_clock() -> None:
    """The outbox gives its turn back to the loop: nobody waits for a client that does not read."""
    outbox = Outbox()
    waiting = asyncio.create_task(outbox.get())
    await asyncio.sleep(0)
    outbox.put(b"now")
    assert await waiting == b"now"
