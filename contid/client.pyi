from contid.remote.client.servo import ServoReport as ServoReport
from contid.remote.client.servo import ServoState as ServoState
from contid.remote.client.sync_client import Client as Client
from contid.remote.protocol.wire import Code as Code
from contid.remote.protocol.wire import ConnectionLostError as ConnectionLostError
from contid.remote.protocol.wire import NoDaemonError as NoDaemonError
from contid.remote.protocol.wire import RemoteError as RemoteError
from contid_library.async_client import AsyncClient as AsyncClient
