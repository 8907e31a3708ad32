from contid.api.robot import Robot as Robot
from contid.api.simulated import Sim as Sim
from contid.client import Client as Client

__version__: str
__all__ = ["Client", "Robot", "Sim", "__version__"]
