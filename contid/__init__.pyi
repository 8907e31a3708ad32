from contid.api.robot import Robot as Robot
from contid.api.simulated import Sim as Sim
from contid.client import Client as Client
from contid.session.read import Session as Session

__version__: str
__all__ = ["Client", "Robot", "Session", "Sim", "__version__"]
