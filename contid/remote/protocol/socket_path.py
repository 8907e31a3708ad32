"""Paths of the sockets of daemons, the listening socket, and the search for running daemons.

The default is ``$XDG_RUNTIME_DIR/contid/NAME.sock``, else a folder of this user below the system's temporary
one. That folder has mode 0700 and is refused when it belongs to another user or is open to others. Services
listen in ``/run/contid``, which systemd creates; clients search there as well.
"""

from __future__ import annotations

import fcntl
import grp
import os
import socket
import stat
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from contid.errors import ContidError
from contid.remote.protocol.connect import connect, default_directory
from contid.remote.protocol.wire import NoDaemonError

#: Where ``host/contid@.service`` puts its sockets.
SERVICES: Final = Path("/run/contid")
#: Maximum bytes of a Unix socket's path, without its closing zero.
MAX_PATH: Final = 107
BACKLOG: Final = 128
#: Longest wait for another daemon that starts in the same folder; it takes milliseconds.
LOCK_TIMEOUT_S: Final = 3.0


class SocketError(ContidError):
    """The daemon cannot listen at this path."""


def default_path(robot_file: str) -> Path:
    """The default path for a robot file: ``NAME.sock``, from the file's name without ``.yaml``."""
    name = Path(robot_file).name
    for ending in (".yaml", ".yml"):
        name = name.removesuffix(ending)
    return default_directory() / f"{name}.sock"


def private_directory() -> Path:
    """The default folder, created or checked.

    Raises:
        SocketError: other users could place a socket there.
    """
    folder = default_directory()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        unset = "unset XDG_RUNTIME_DIR, or " if os.environ.get("XDG_RUNTIME_DIR") else ""
        what = f"{folder}: cannot create this folder: {error.strerror}; {unset}give --socket"
        raise SocketError(what) from error
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & 0o077:
        raise SocketError(
            f"{folder}: must be a folder of user {os.geteuid()} with mode 0700; correct it or give --socket"
        )
    return folder


def running() -> list[Path]:
    """Sockets of running daemons that a client may trust: those of this user, then those of services."""
    folders = [folder for folder in (default_directory(), SERVICES) if os.access(folder, os.R_OK | os.X_OK)]
    paths = [path for folder in folders for path in sorted(folder.glob("*.sock"))]
    return [path for path in paths if is_listening(path, trusted=True)]


def is_listening(path: Path, trusted: bool = False) -> bool:
    """True when a process listens at a socket; with ``trusted`` only one that a client may use."""
    try:
        connect(path).close()
    except BlockingIOError:  # it listens, with a full backlog
        return True
    except (ConnectionRefusedError, FileNotFoundError):
        return False
    except (NoDaemonError, OSError):  # of another user, or this process may not look
        return not trusted
    return True


def find(given: str | None) -> Path:
    """The given socket, or that of the only running daemon.

    Raises:
        NoDaemonError: none, or several.
    """
    if given is not None:
        return Path(given)
    found = running()
    if len(found) == 1:
        return found[0]
    if not found:
        message = f"no daemon runs ({default_directory()} and {SERVICES} hold no live socket of yours)"
        if _foreign(default_directory()):
            message = f"no daemon runs, and {default_directory()} belongs to another user: it is not used"
        if SERVICES.is_dir() and not os.access(SERVICES, os.R_OK | os.X_OK):
            message = (
                f"no daemon of yours runs, and {SERVICES} of the service is closed to you: join its group"
            )
        raise NoDaemonError(f"{message}; start one with `contid run ROBOT.yaml`, or give --socket PATH")
    listed = "\n  ".join(f"--socket {path}" for path in found)
    raise NoDaemonError(f"{len(found)} daemons run; choose one:\n  {listed}")


def _lock(descriptor: int, folder: Path) -> None:
    """Lock a folder: any process that may read it could hold the lock for ever.

    Raises:
        SocketError: it is locked for longer than a start takes.
    """
    deadline_s = time.monotonic() + LOCK_TIMEOUT_S
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > deadline_s:
                message = f"{folder}: another process holds a lock on this folder (`lsof +D` names it)"
                raise SocketError(f"{message}; end it, or give --socket in another folder") from None
            time.sleep(0.01)
        else:
            return


def _foreign(folder: Path) -> bool:
    """True when another user could have placed sockets in a folder of this user."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    return found.st_uid != os.geteuid() or not stat.S_ISDIR(found.st_mode)


def _group(option: str, name: str | None) -> int | None:
    """The number of a group, None without a name.

    Raises:
        SocketError: there is no such group.
    """
    try:
        return None if name is None else grp.getgrnam(name).gr_gid
    except KeyError:
        what = f"{option} {name}: no such group; `sudo groupadd --system {name}` creates it"
        raise SocketError(what) from None


class Endpoint:
    """A listening socket with mode 0600; refuses a second daemon, removes the socket of a killed one.

    Args:
        path: path of the socket.
        default: the path is the default one: create or check its folder.
        group: name of a group whose members may connect as well; the mode is then 0660.
        watch_group: name of a group whose members may only read and stop. The mode is 0660 with one group and
            0666 with both, as a file has one group: then the check of the peer alone keeps others out.

    Raises:
        SocketError: from the constructor, with the remedy.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        default: bool = False,
        group: str | None = None,
        watch_group: str | None = None,
    ) -> None:
        self.path = Path(path)
        self._default, self._groups = default, (group, watch_group)
        self.group = _group("--socket-group", group)
        self.watch_group = _group("--watch-group", watch_group)
        if default:
            private_directory()
        if len(os.fsencode(self.path)) > MAX_PATH:
            raise SocketError(
                f"{self.path}: a socket's path has at most {MAX_PATH} bytes; give a shorter one"
            )
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            # The lock on the folder makes check and bind atomic for two daemons that start together.
            folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY)
            try:
                _lock(folder, self.path.parent)
                self._remove_stale()
                self._bind()
            finally:
                os.close(folder)
        except OSError as error:
            self.socket.close()
            raise SocketError(f"{self.path}: cannot listen there: {error.strerror}") from error
        except BaseException:
            self.socket.close()
            raise
        self._status = self.path.stat()

    def _remove_stale(self) -> None:
        try:
            found = self.path.lstat()
        except FileNotFoundError:
            return
        if not stat.S_ISSOCK(found.st_mode):
            raise SocketError(
                f"{self.path}: exists and is not a socket; it is not removed, give another path"
            )
        if is_listening(self.path):
            raise SocketError(
                f"{self.path}: another daemon listens there; stop it, or give this one its own --socket PATH"
            )
        self.path.unlink()

    def _bind(self) -> None:
        # No other user may connect between bind and chmod either.
        before = os.umask(0o177)
        try:
            self.socket.bind(str(self.path))
        finally:
            os.umask(before)
        groups = {each for each in (self.group, self.watch_group) if each is not None}
        try:
            for each in groups:
                os.chown(self.path, -1, each)
            self.path.chmod((0o600, 0o660, 0o666)[len(groups)])
            self.socket.listen(BACKLOG)
        except OSError as error:
            self.path.unlink()
            if not isinstance(error, PermissionError):
                raise
            names = " and ".join(sorted(grp.getgrgid(each).gr_name for each in groups))
            message = f"{self.path}: only a member of group {names} may give the socket to it"
            raise SocketError(f"{message}; let an administrator add this user, and log in again") from error
        self.socket.setblocking(False)

    def again(self) -> Endpoint | None:
        """This endpoint made anew where its default folder was removed, as systemd does at the last logout.

        None while it stands, or cannot be made yet.
        """
        if self._default and not os.path.lexists(self.path):
            with suppress(SocketError, OSError):
                return Endpoint(self.path, default=True, group=self._groups[0], watch_group=self._groups[1])
        return None

    def close(self) -> None:
        """Stop listening and remove the socket, if it is still this one; idempotent."""
        self.socket.close()
        with suppress(OSError):
            if os.path.samestat(self.path.lstat(), self._status):
                self.path.unlink()
