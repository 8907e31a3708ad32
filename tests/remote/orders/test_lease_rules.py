"""The rules of the lease, without a daemon."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from contid.remote.protocol.wire import Code, RemoteError
from contid.remote.server.lease import MAX_STOPS, ClientStop, Lease


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
    lease.allow(1, 0.0, after_stop=False)
    assert lease.expire(1e9) is None
    assert lease.stop(1, "one (hold)") is None
    assert lease.held_by(0)
    lease.acquire(1, "one", 0.0, takeover=True)
    assert not lease.held_by(0)


def test_a_lease_revoked_by_a_stop_must_be_acquired_explicitly() -> None:
    lease = Lease(0.0, input_active=False)
    lease.require(1, "script", 0.0)
    assert lease.stop(2, "person (estop)") is not None
    with pytest.raises(RemoteError) as refused:
        lease.require(1, "script", 0.1)
    assert refused.value.code == Code.STOPPED
    lease.acquire(1, "script", 0.2)
    lease.require(1, "script", 0.3)


def go_on(lease: Lease, stops: Mapping[int, ClientStop]) -> None:
    for client, stop in stops.items():
        lease.end_stop(client, stop)


def test_after_a_stop_only_the_stopper_or_an_explicit_request_goes_on() -> None:
    """The lease was free, or the input's: a script that takes it for each move does not undo the stop."""
    for input_active in (False, True):
        lease = Lease(0.0, input_active=input_active)
        assert lease.stop(2, "person (estop)") is None
        with pytest.raises(RemoteError) as refused:
            lease.allow(1, 0.1, after_stop=False)
        assert refused.value.code == Code.STOPPED
        if not input_active:
            with pytest.raises(RemoteError, match="person"):
                lease.require(1, "script", 0.1)
        lease.check_free(1, 0.1)  # clearing a fault moves nothing
        with pytest.raises(RemoteError, match="person"):
            lease.allow(1, 0.2, after_stop=False)
        go_on(lease, lease.allow(2, 0.3, after_stop=False))
        lease.allow(1, 0.4, after_stop=False)
        lease.stop(2, "person (hold)")
        admitted = lease.allow(3, 0.5, after_stop=True)
        with pytest.raises(RemoteError, match="person"):
            lease.allow(1, 0.5, after_stop=False)  # the order may still be refused
        go_on(lease, admitted)
        lease.allow(1, 0.6, after_stop=False)


def test_the_stop_of_the_holder_keeps_its_lease_and_bars_the_others() -> None:
    lease = Lease(0.0, input_active=False)
    lease.require(1, "one", 0.0)
    assert lease.stop(1, "one (hold)") is None
    lease.release(1)
    with pytest.raises(RemoteError, match="one"):
        lease.require(2, "two", 0.1)
    lease.end_stop(1, lease.require(1, "one", 0.2))
    lease.release(1)
    lease.require(2, "two", 0.3)


def test_stops_of_several_clients_stand_side_by_side() -> None:
    lease = Lease(0.0, input_active=False)
    lease.stop(1, "person (estop)")
    for script in range(2, 100):
        lease.stop(script, f"script {script} (hold)")
        with pytest.raises(RemoteError, match="person"):
            lease.require(script, "script", 0.1)
    assert "person (estop); script 2 (hold)" in lease.stopped_by
    assert len(lease.stopped_by) < 400
    lease.acquire(5, "script", 0.2)
    assert lease.stopped_by == ""


def test_the_stop_of_a_client_stands_until_it_moves() -> None:
    """A move that is being checked may still be refused, or be ended by a third client, who then moves."""
    lease = Lease(0.0, input_active=False)
    lease.stop(1, "person (hold)")
    own = lease.require(1, "person", 0.1)
    lease.release(1)
    with pytest.raises(RemoteError, match="person"):
        lease.require(2, "script", 0.2)
    lease.stop(1, "person (estop)")
    lease.end_stop(1, own)  # the hold; the estop came after it
    with pytest.raises(RemoteError, match="estop"):
        lease.require(2, "script", 0.3)
    lease.end_stop(1, lease.require(1, "person", 0.4))
    assert lease.stopped_by == ""


def test_who_acquires_unless_stopped_has_not_moved_yet() -> None:
    lease = Lease(0.0, input_active=False)
    lease.stop(1, "person (hold)")
    lease.acquire(1, "person", 0.1, unless_stopped=True)
    lease.release(1)
    with pytest.raises(RemoteError, match="person"):
        lease.require(2, "script", 0.2)
    lease.acquire(2, "script", 0.3)
    assert lease.stopped_by == ""


def test_a_stop_during_a_resume_stands_however_many_came_before() -> None:
    """The ninth was not noted; the end of the resume then left none, and any script could move."""
    lease = Lease(0.0, input_active=False)
    for client in range(1, MAX_STOPS + 1):
        lease.stop(client, f"client {client}")
    stood = lease.allow(50, 1.0, after_stop=True)
    lease.stop(99, "client 99")
    for client, stop in stood.items():
        lease.end_stop(client, stop)
    with pytest.raises(RemoteError, match="client 99 stopped the robots"):
        lease.require(50, "script", 2.0)
