"""A robot file that asks for a mechanism of an extra is refused where its package was removed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

import contid
from contid import entry_points
from contid.control.engine.wiring import build_robot_configs, chains_of, clearance_of
from contid.errors import ContidError
from contid.robot_file.load import LoadedFile, load_named
from tests.sense.squeeze_runs import hand


@pytest.fixture(autouse=True)
def no_packages(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    entry_points.required.cache_clear()
    monkeypatch.setattr(entry_points, "entry_points", lambda **_: ())
    yield
    entry_points.required.cache_clear()


def configs_of(loaded: LoadedFile) -> object:
    return build_robot_configs(loaded, 100.0)


@pytest.mark.parametrize(
    ("load", "use", "what", "package"),
    [
        (lambda: load_named("hand"), clearance_of, "its key `clearance`", "contid_clearance"),
        (lambda: load_named("chain"), chains_of, "its model `chain`", "contid_ropes"),
        (lambda: load_named("catheter"), configs_of, "tendon", "contid_tendons"),
        (lambda: load_named("trunk"), configs_of, "tendon", "contid_tendons"),
        (lambda: hand(3.0), configs_of, "its key `sense.nm_per_a`", "contid_contact"),
    ],
    ids=["clearance", "chain", "catheter", "trunk", "contact"],
)
def test_a_file_is_refused_with_the_remedy(
    load: Callable[[], LoadedFile], use: Callable[[LoadedFile], Any], what: str, package: str
) -> None:
    loaded = load()
    with pytest.raises(ContidError, match=f"needs the package {package}, which is not installed") as refused:
        use(loaded)
    assert what in str(refused.value)


@pytest.mark.parametrize("name", ["ElasticRod", "Sim", "Wrench"])
def test_a_name_of_the_library_is_refused_with_the_remedy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(vars(contid), name, raising=False)
    with pytest.raises(ContidError, match=f"contid.{name} needs the package contid_library"):
        getattr(contid, name)
