"""A session that cannot be opened leaves no process behind."""

from __future__ import annotations

import pytest

from contid.robot_file.load import load_named
from contid_view.rerun import session
from contid_view.rerun.session import RerunSession
from contid_view.view_target import Kind, ViewTarget


@pytest.mark.parametrize("failing", ["writer", "connection"])
def test_a_server_ends_where_the_session_cannot_be_opened(
    failing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended: list[bool] = []

    class Server:
        data_url = "rerun+http://127.0.0.1:1/proxy" if failing == "writer" else "no address"

        def close(self) -> None:
            ended.append(True)

    def refuses(*arguments: object) -> None:
        raise RuntimeError("made")

    monkeypatch.setattr(session, "WebServer", Server)
    if failing == "writer":
        monkeypatch.setattr(session, "RerunWriter", refuses)
    with pytest.raises(Exception, match=r"made|address|URI|URL|url"):
        RerunSession(ViewTarget(Kind.SERVE, None), load_named("finger"), 200.0, True)
    assert ended == [True]
